"""WHAT SEES WHAT: rays, form factors, and the shadows of height fields."""

from torchradiometry.transport.blockers import convex_blockers, possible_blockers
from torchradiometry.transport.brute_force import BruteForceRays
from torchradiometry.transport.closure import cap_rows, close_enclosure
from torchradiometry.transport.embree import EmbreeRays
from torchradiometry.transport.exchange import polygon_exchange, unoccluded_exchange
from torchradiometry.transport.exchange_links import ExchangeLinks, exchange_links
from torchradiometry.transport.form_factors import exchange_areas, form_factors
from torchradiometry.transport.height_field import height_field_hits, height_field_visibility
from torchradiometry.transport.links import Refinement
from torchradiometry.transport.occluded_exchange import OccludedExchange, occluded_exchange
from torchradiometry.transport.rays import AbstractRayCaster, Hits
from torchradiometry.transport.rules import PatchPoints, patch_points, sample_patches
from torchradiometry.transport.shafts import certain_pairs
from torchradiometry.transport.unoccluded import UnoccludedFormFactors
from torchradiometry.transport.visibility import PairVisibility, pair_visibility
from torchradiometry.transport.visible_parts import (
    VisibleParts,
    visible_irradiance,
    visible_polygon,
)

__all__ = [
    "AbstractRayCaster",
    "BruteForceRays",
    "EmbreeRays",
    "ExchangeLinks",
    "Hits",
    "OccludedExchange",
    "PairVisibility",
    "PatchPoints",
    "Refinement",
    "UnoccludedFormFactors",
    "VisibleParts",
    "cap_rows",
    "certain_pairs",
    "close_enclosure",
    "convex_blockers",
    "exchange_areas",
    "exchange_links",
    "form_factors",
    "height_field_hits",
    "height_field_visibility",
    "occluded_exchange",
    "pair_visibility",
    "patch_points",
    "polygon_exchange",
    "possible_blockers",
    "sample_patches",
    "unoccluded_exchange",
    "visible_irradiance",
    "visible_polygon",
]
