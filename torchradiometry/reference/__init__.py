"""INDEPENDENT TRUTH: closed forms, and pictures of an independent rasteriser."""

from torchradiometry.reference import closed_forms
from torchradiometry.reference.pyrender import ReferenceBuffers, render_reference

__all__ = ["ReferenceBuffers", "closed_forms", "render_reference"]
