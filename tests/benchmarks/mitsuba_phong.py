"""Phong's lobe beside Lambert's, for Mitsuba, which has no Phong of its own.

    f_r = rho/pi + k_s (n+2)/(2 pi) cos^n(alpha)

Written against Mitsuba's interface and drawing its own directions (half from the cosine, half from
the lobe), so that a path tracer's picture of shiny surfaces shares no code with ours.
"""

from __future__ import annotations

from typing import Any

from torchradiometry import Surface

try:
    import drjit as dr
    import mitsuba as mi
except ImportError:
    dr = mi = None

__all__ = ["phong_bsdf"]


def phong_bsdf(surface: Surface) -> Any:
    """The material of a shiny one-sided surface."""
    if "lambert_phong" not in _made:
        mi.register_bsdf("lambert_phong", _bsdf())
        _made.append("lambert_phong")
    return {
        "type": "lambert_phong",
        "diffuse": {"type": "rgb", "value": surface.albedo.expand(3).tolist()},
        "specular": {"type": "rgb", "value": surface.specular.expand(3).tolist()},
        "shininess": float(surface.shininess),
    }


_made: list[str] = []


def _bsdf() -> Any:
    class LambertPhong(mi.BSDF):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.diffuse = mi.Color3f(props["diffuse"])
            self.specular = mi.Color3f(props["specular"])
            self.n = mi.Float(props["shininess"])
            flag = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flag]
            self.m_flags = flag

        def _alpha(self, si: Any, wo: Any) -> Any:
            mirrored = mi.Vector3f(-si.wi.x, -si.wi.y, si.wi.z)
            return dr.maximum(dr.dot(mirrored, wo), 0)

        def _power(self, si: Any, wo: Any) -> Any:
            cosine = self._alpha(si, wo)
            return dr.select(cosine > 0, cosine**self.n, 0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            up = active & (si.wi.z > 0) & (wo.z > 0)
            lobe = (self.n + 2) / (2 * dr.pi) * self._power(si, wo)
            diffuse = self.diffuse / dr.pi
            value = (diffuse + self.specular * lobe) * wo.z
            return dr.select(up, value, 0)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            up = active & (si.wi.z > 0) & (wo.z > 0)
            lobe = (self.n + 1) / (2 * dr.pi) * self._power(si, wo)
            return dr.select(up, 0.5 * wo.z / dr.pi + 0.5 * lobe, 0)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            cosine = mi.warp.square_to_cosine_hemisphere(sample2)
            height = dr.power(1 - sample2.x, 1 / (self.n + 1))
            radius = dr.safe_sqrt(1 - height * height)
            sine, cos = dr.sincos(2 * dr.pi * sample2.y)
            mirrored = mi.Vector3f(-si.wi.x, -si.wi.y, si.wi.z)
            about = mi.Frame3f(mirrored).to_world(mi.Vector3f(radius * cos, radius * sine, height))
            bs = mi.BSDFSample3f()
            bs.wo = dr.select(sample1 < 0.5, cosine, about)
            bs.pdf = self.pdf(ctx, si, bs.wo, active)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
            bs.sampled_component = mi.UInt32(0)
            ok = active & (bs.pdf > 0)
            value = self.eval(ctx, si, bs.wo, ok) / dr.select(ok, bs.pdf, 1)
            return bs, dr.select(ok, value, 0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def to_string(self) -> str:
            return "LambertPhong[]"

    return LambertPhong
