"""INDEPENDENT TRUTH: closed forms, and pictures of an independent rasteriser."""

from torchradiometry.reference import closed_forms

__all__ = ["closed_forms"]
