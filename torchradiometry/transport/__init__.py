"""WHAT SEES WHAT: rays, form factors, and the shadows of height fields."""

from torchradiometry.transport.brute_force import BruteForceRays
from torchradiometry.transport.closure import cap_rows, close_enclosure
from torchradiometry.transport.embree import EmbreeRays
from torchradiometry.transport.exchange import unoccluded_exchange
from torchradiometry.transport.form_factors import exchange_areas, form_factors
from torchradiometry.transport.height_field import height_field_hits, height_field_visibility
from torchradiometry.transport.rays import AbstractRayCaster, Hits
from torchradiometry.transport.rules import PatchPoints, patch_points, sample_patches
from torchradiometry.transport.visibility import pair_visibility, possible_blockers

__all__ = [
    "AbstractRayCaster",
    "BruteForceRays",
    "EmbreeRays",
    "Hits",
    "PatchPoints",
    "cap_rows",
    "close_enclosure",
    "exchange_areas",
    "form_factors",
    "height_field_hits",
    "height_field_visibility",
    "pair_visibility",
    "patch_points",
    "possible_blockers",
    "sample_patches",
    "unoccluded_exchange",
]
