"""The pictures of the lecture: four laws of light, each drawn by the layers themselves.

    light            solid angle and irradiance of a panel, and the cosine law
    reflection       six materials under one lamp, their lobes, and what share they reflect (DHR)
    sources          a ball on a floor under six kinds of light
    interreflection  a room by the number of reflections, and with one number in their place

Run it: `python examples/lecture.py`. It writes `docs/pictures/lecture_light.png` and so on, and
prints the figures that the pages of the lecture name.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from torchradiometry.demo.curve import write_panels
from torchradiometry.files import linear_to_srgb
from torchradiometry.geometry import polygon_irradiance, solid_angle_polygon, spherical_direction
from torchradiometry.materials import (
    AbstractMaterial,
    BlinnPhong,
    Lambertian,
    LambertianSpecular,
    Microfacet,
    OrenNayar,
    SumMaterial,
    directional_hemispherical_reflectance,
)
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.scene import Scene, Surface, cornell_like_room, quad, sphere
from torchradiometry.scene.standard import camera, ground
from torchradiometry.shade import shade_points
from torchradiometry.sources import AmbientDome, DirectionalSource, PointSource, SpotSource

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
#: a square of 1 m that shines down, about the vertical axis
PANEL = torch.tensor([[0.5, -0.5, 0], [-0.5, -0.5, 0], [-0.5, 0.5, 0], [0.5, 0.5, 0]]).double()
UP = torch.tensor([0.0, 0, 1]).double()
MATERIALS: dict[str, Callable[[], AbstractMaterial]] = {
    "Lambertian, 0.6": lambda: Lambertian([0.6]),
    "Oren-Nayar, rough 0.9": lambda: OrenNayar([0.6], [0.9]),
    "Phong, n = 20": lambda: LambertianSpecular([0.5], 0.1, 20.0),
    "Phong, n = 200": lambda: LambertianSpecular([0.5], 0.1, 200.0),
    "Blinn-Phong, n = 80": lambda: SumMaterial([Lambertian([0.5]), BlinnPhong([0.1], [80.0])]),
    "microfacets, 0.2": lambda: SumMaterial([OrenNayar([0.5], [0.3]), Microfacet([0.06], [0.2])]),
}


def show(axes: Axes, radiance: Tensor, title: str, exposure: float) -> None:
    """A linear picture `H W 3`, or `H W`, as a screen shows it."""
    radiance = radiance if radiance.ndim == 3 else radiance.unsqueeze(-1).expand(-1, -1, 3)
    axes.imshow(linear_to_srgb((exposure * radiance).clamp(0, 1).double().numpy()))
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()


def light(out: Path, fast: bool) -> dict[str, float]:
    """Solid angle of a panel by distance, its irradiance over a floor and on a tilted receiver."""
    figure = Figure(figsize=(9.6, 3.1), layout="constrained")
    angle, floor, tilted = figure.subplots(1, 3)
    distance = torch.logspace(-1.5, 1, 20 if fast else 80, dtype=torch.float64)
    below = distance.reshape(-1, 1, 1) * -UP
    exact = solid_angle_polygon(below.squeeze(1), PANEL.expand(len(distance), 4, 3)).abs()
    angle.loglog(distance, exact, label="exact")
    angle.loglog(distance, 1 / distance.square(), "--", label="A / r²")
    angle.axhline(2 * math.pi, color="0.7", lw=0.8)
    angle.text(0.8, 7.5, "half space: 2π", fontsize=8, color="0.4")
    angle.set(xlabel="distance, m", ylabel="solid angle of 1 m², sr", ylim=(5e-3, 1e2))
    angle.legend(frameon=False, fontsize=8)

    size = 24 if fast else 120
    axis = torch.linspace(-2, 2, size, dtype=torch.float64)
    x, y = torch.meshgrid(axis, axis, indexing="xy")
    points = torch.stack((x, y, torch.full_like(x, -1)), -1)
    lit = polygon_irradiance(points, UP.expand_as(points), PANEL)
    drawn = floor.contourf(x, y, lit, 24, cmap="inferno")
    floor.set(title="irradiance of the floor 1 m below, W/m²", aspect="equal", xlabel="m")
    floor.title.set_fontsize(9)
    figure.colorbar(drawn, ax=floor, shrink=0.8)

    tilt = torch.linspace(0, math.pi, 181, dtype=torch.float64)
    normal = torch.stack((tilt.sin(), torch.zeros_like(tilt), tilt.cos()), -1)
    for height in (0.25, 1.0, 4.0):
        turned = polygon_irradiance((-height * UP).expand_as(normal), normal, PANEL)
        tilted.plot(tilt.rad2deg(), turned / turned[0], label=f"panel at {height:g} m")
    tilted.plot(tilt.rad2deg(), tilt.cos().clamp(min=0), "k:", lw=1, label="max(0, cos)")
    tilted.set(xlabel="tilt of the receiver, degrees", ylabel="irradiance, of its value at 0")
    tilted.legend(frameon=False, fontsize=8)
    figure.savefig(out, dpi=110)
    near = 1 / float(solid_angle_polygon((-UP).double(), PANEL).abs())
    return {"A / r^2 over the solid angle at 1 m": near, "irradiance at 1 m": float(lit.max())}


def ball(size: int) -> tuple[Tensor, Tensor]:
    """Normals `point 3` of a ball seen from +z, and which pixels show it."""
    axis = torch.linspace(1.05, -1.05, size, dtype=torch.float64)
    y, x = torch.meshgrid(axis, -axis, indexing="ij")
    square = x.square() + y.square()
    normal = torch.stack((x, y, (1 - square).clamp(min=0).sqrt()), -1)
    return normal[square < 1], square < 1


def reflection(out: Path, fast: bool) -> dict[str, float]:
    """Balls, lobes at 45 degrees and reflectances of six materials."""
    figure = Figure(figsize=(9.6, 5.0), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1, 1.5])
    lamp = DirectionalSource([0.6, 0.7, 1.0], [math.pi]).double()
    normal, seen = ball(32 if fast else 160)
    for axes, (name, build) in zip(above.subplots(1, 6), MATERIALS.items(), strict=True):
        picture = torch.zeros(seen.shape, dtype=torch.float64)
        found = shade_points(build().double(), [lamp], None, normal, UP.expand_as(normal))
        picture[seen] = found.squeeze(-1)
        show(axes, picture, name, 1.0)
    polar = below.add_subplot(1, 2, 1, projection="polar")
    curve = below.add_subplot(1, 2, 2)
    angle = torch.linspace(-math.pi / 2, math.pi / 2, 181, dtype=torch.float64)
    wo = torch.stack((angle.sin(), torch.zeros_like(angle), angle.cos()), -1)
    wi = spherical_direction(torch.tensor(math.pi / 4), torch.tensor(math.pi)).double()
    tilts = torch.linspace(0, 85, 5 if fast else 18)
    shares = {}
    for name, build in MATERIALS.items():
        material = build().double()
        lobe = material(wi.expand_as(wo), wo, UP.expand_as(wo)).squeeze(-1)
        polar.plot(angle, lobe.clamp(max=0.6), lw=1.2)
        dhr = [directional_hemispherical_reflectance(material, math.radians(t)) for t in tilts]
        curve.plot(tilts, [float(share) for share in dhr], lw=1.2, label=name)
        shares[name] = float(dhr[0])
    polar.set(thetamin=-90, thetamax=90, theta_zero_location="N", theta_direction=-1)
    polar.set_title("BRDF for light from 45° on the left, 1/sr (cut at 0.6)", fontsize=9)
    polar.tick_params(labelsize=7)
    curve.set(
        xlabel="angle of incidence, degrees", ylabel="reflected share (DHR)", ylim=(0.4, 0.75)
    )
    curve.legend(frameon=False, fontsize=7)
    figure.savefig(out, dpi=110)
    return shares


def panel(half: float, height: float, power: float) -> Surface:
    """A square that shines down, as strong straight on as a lamp of that intensity, W/sr."""
    x, z, h = 1.2, 0.6, half
    place = [[x - h, height, z - h], [x + h, height, z - h]]
    place += [[x + h, height, z + h], [x - h, height, z + h]]
    return quad("panel", place, albedo=0.0, emission=power / (4 * half * half))


def sources(out: Path, fast: bool) -> dict[str, float]:
    """A ball that hovers over a floor, under six kinds of light."""
    size = (24, 18) if fast else (200, 150)
    objects = (
        ground("floor", 4.0, albedo=0.6),
        sphere(
            "ball", 0.5, (0.0, 0.65, 0.0), subdivisions=2 if fast else 4, albedo=[0.7, 0.4, 0.2]
        ),
    )
    view = camera(*size, (0.6, 2.6, 4.2), (-0.2, 0.3, 0), 40)
    place, white = [1.2, 2.6, 0.6], [1.0] * 3
    aim = [-1.2, -2.0, -0.6]
    power = 22.0
    kinds: dict[str, tuple[tuple[Surface, ...], tuple[object, ...]]] = {
        "far away (sun)": ((), (DirectionalSource([1.2, 2.0, 0.6], [[3.0] * 3]),)),
        "small and near (lamp)": ((), (PointSource(place, [power * c for c in white]),)),
        "a lamp in a cone (spot)": (
            (),
            (SpotSource(place, aim, [power * c for c in white], 0.22, 0.32),),
        ),
        "a panel of 0.4 m": ((panel(0.2, 2.6, power),), ()),
        "a panel of 1.6 m": ((panel(0.8, 2.6, power),), ()),
        "the whole sky": ((), (AmbientDome([1.0]),)),
    }
    figure = Figure(figsize=(9.6, 5.2), layout="constrained")
    found = {}
    settings = RenderSettings(
        bounces=0,
        supersampling=1 if fast else 3,
        sky_samples=16 if fast else 256,
        shadow_samples=16,
    )
    for axes, (name, (more, lamps)) in zip(figure.subplots(2, 3).flat, kinds.items(), strict=True):
        scene = Scene((*objects, *more), lamps, view)  # type: ignore[arg-type]
        with torch.no_grad():
            picture = render_scene(scene, view[0], settings).radiance
        found[name] = float((picture.mean(-1) < 0.02 * picture.mean(-1).max()).float().mean())
        show(axes, picture, name, 0.9 / float(picture.quantile(0.995)))
    figure.savefig(out, dpi=100)
    return found


def interreflection(out: Path, fast: bool) -> dict[str, float]:
    """A room by bounces, and with one calibrated number in place of all of them."""
    size = 20 if fast else 180
    scene = cornell_like_room(width=size, height=size)
    common = {"supersampling": 1 if fast else 2, "patch_size": 2.0 if fast else 0.6}
    ways = {
        "direct light": RenderSettings(bounces=0, **common),  # type: ignore[arg-type]
        "+ an ambient number": RenderSettings(bounces=0, ambient=True, **common),  # type: ignore[arg-type]
        "+ 1 bounce": RenderSettings(bounces=1, ambient_tail=False, **common),  # type: ignore[arg-type]
        "+ 2 bounces": RenderSettings(bounces=2, ambient_tail=False, **common),  # type: ignore[arg-type]
        "+ all": RenderSettings(bounces=24, **common),  # type: ignore[arg-type]
    }
    shares, pictures = {}, {}
    for name, settings in ways.items():
        with torch.no_grad():
            pictures[name] = render_scene(scene, scene.cameras[0], settings)
    full = pictures["+ all"]
    exposure = 1 / float(full.radiance[~full.emitter].quantile(0.98))
    for name, picture in pictures.items():
        keep = ~full.emitter
        shares[name] = float(picture.radiance[keep].sum() / full.radiance[keep].sum())
    panels = [picture.radiance.numpy() for picture in pictures.values()]
    write_panels(out, [panels], [*ways], exposure=exposure)
    return shares


LAWS = {
    "light": light,
    "reflection": reflection,
    "sources": sources,
    "interreflection": interreflection,
}


def main(fast: bool = False, out: Path = PICTURES) -> dict[str, dict[str, float]]:
    """Draw all four; the figures that each shows."""
    out.mkdir(parents=True, exist_ok=True)
    return {name: draw(out / f"lecture_{name}.png", fast) for name, draw in LAWS.items()}


if __name__ == "__main__":
    for title, numbers in main().items():
        print(title, {name: round(value, 4) for name, value in numbers.items()})
