"""What a picture will take: seconds by cause, from counts and this machine's prices.

    seconds = sum over causes of  price x count

Counts follow from the scene, the camera and the settings (pixels, points x shining polygons,
pairs of patches, ...); prices are fitted once per machine to the stages of a few pictures of
standard scenes, by least squares of logarithms, and stored. A machine without stored
prices gets those of an ordinary processor core.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch

from torchradiometry.errors import FileFormatError
from torchradiometry.files import atomic_path, check_readable
from torchradiometry.plan.pilot import Pilot
from torchradiometry.render.ambient import POINTS as SAMPLE
from torchradiometry.render.ambient import RAYS
from torchradiometry.render.indirect import MOST_DENSE
from torchradiometry.render.picture import develop, view_scene
from torchradiometry.render.settings import RenderSettings
from torchradiometry.scene.standard import STANDARD_SCENES

__all__ = ["Costs", "calibrate", "counts", "stored_costs"]

#: seconds each on one core of an ordinary processor, in millionths
MICROSECONDS = {
    "start": 5000,
    "triangle": 0.4,
    "ray": 2.5,
    "batch": 4000,
    "lamp point": 5,
    "polygon point": 6,
    "shadow ray": 2.5,
    "clipped point": 1.5,
    "patch": 60,
    "pair": 2,
    "blocked pair": 2,
    "clustered patch": 800,
    "bounce pair": 0.002,
    "picture": 1000,
    "bounce": 100,
    "surface point": 0.2,
}
DEFAULT = {name: price / 1_000_000 for name, price in MICROSECONDS.items()}
#: weight of the default's proportions where pictures leave prices open
WEAKLY = 0.05
#: largest logarithm of a price over the default's
FARTHEST = 3.0
#: stages of a picture, and the causes that each is made of
STAGES = {
    "prepare": ("start", "triangle"),
    "direct": ("batch", "ray", "lamp point", "polygon point", "shadow ray", "clipped point"),
    "indirect": ("patch", "pair", "blocked pair", "clustered patch"),
    "shade": ("picture", "bounce", "surface point", "bounce pair"),
}
#: pictures that prices are fitted to: scene, size, settings
TRIALS = (
    ("ball", 64, RenderSettings(bounces=0, shadow_samples=0)),
    ("ball", 256, RenderSettings(bounces=0, shadow_samples=0)),
    ("crate", 128, RenderSettings(bounces=0)),
    ("cornell", 64, RenderSettings(bounces=0, extent=False, shadow_samples=0)),
    ("cornell", 128, RenderSettings(bounces=0, penumbra=False)),
    ("cornell", 128, RenderSettings(bounces=0)),
    ("columns", 48, RenderSettings(bounces=0)),
    ("groove", 32, RenderSettings(patch_size=0.25)),
    ("white room", 32, RenderSettings(patch_size=1.5)),
    ("cornell", 32, RenderSettings(patch_size=2.0)),
    ("cornell", 32, RenderSettings(patch_size=1.0, bounces=16)),
    ("two rooms", 32, RenderSettings(patch_size=1.0, bounces=48)),
)


@dataclass(frozen=True)
class Costs:
    """Prices of this machine.

    Attributes:
        prices: seconds each.
        calibrated: whether they were fitted here.
    """

    prices: dict[str, float] = field(default_factory=lambda: dict(DEFAULT))
    calibrated: bool = False

    def seconds(self, pilot: Pilot, settings: RenderSettings) -> dict[str, float]:
        """Predicted seconds of each stage."""
        found = counts(pilot, settings)
        return {
            stage: sum(self.prices[cause] * found[cause] for cause in causes)
            for stage, causes in STAGES.items()
        }

    def save(self, path: str | Path) -> None:
        """Write them to a JSON file."""
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps({"prices": self.prices}, indent=1))

    @classmethod
    def load(cls, path: str | Path) -> Costs:
        """Read what `save` wrote.

        Raises:
            InputFileError, FileFormatError: no such file, or not of this kind.
        """
        try:
            found = json.loads(check_readable(path, "prices").read_text())["prices"]
            prices = {name: float(found[name]) for name in DEFAULT}
        except (ValueError, KeyError, TypeError) as error:
            raise FileFormatError(str(path), "no prices", "calibrate again") from error
        if not all(0 <= price < math.inf for price in prices.values()):
            raise FileFormatError(str(path), "prices that are no numbers", "calibrate again")
        return cls(prices, True)


def counts(pilot: Pilot, settings: RenderSettings) -> dict[str, float]:
    """How often each cause occurs in a picture with `settings`."""
    world, camera = pilot.world, pilot.camera
    pixels = camera.width * camera.height if camera is not None else 0
    side, edges = settings.supersampling, 2 * pilot.one_ray.share
    more = edges * (4 * side**2 + 2) if side > 1 else 0.0
    points = pixels * (1 + (2 * edges if side > 1 else 0)) * max(pilot.seen, 1 / 64)
    polygons, blockers = len(world.emitters.corners), world.blockers
    lamps, balance = len(pilot.scene.sources), SAMPLE if settings.ambient else 0
    points += balance
    count = pilot.patch_count(settings.patch_size) if settings.patch_size else 0.0
    count = count if settings.bounces else 0.0
    dense = count <= MOST_DENSE
    shaded = settings.shadow_samples > 0
    exact = shaded and settings.penumbra and settings.extent and blockers is not None
    rays = settings.shadow_samples if settings.penumbra and settings.extent else 1
    clipped = polygons * len(blockers) if exact and blockers is not None else 0
    return {
        "start": 1.0,
        "triangle": float(len(world.triangles.surface)),
        "ray": pixels * (1 + more) + balance * RAYS,
        "batch": 2.0 if side == 1 else 4.0,
        "lamp point": lamps * points * (1.0 if settings.near else 0.5),
        "polygon point": polygons * points * (1.0 if settings.extent else 0.3),
        "shadow ray": points * shaded * (lamps + (0 if exact else polygons * rays)),
        "clipped point": points * clipped,
        "patch": count * dense * (1 + lamps + polygons + (clipped or rays * shaded * polygons) / 4),
        "pair": (count * dense) ** 2 / 2,
        "blocked pair": (count * dense) ** 2 / 2 * pilot.blocks,
        "clustered patch": count * (not dense),
        "picture": 1.0,
        "bounce": float(settings.bounces),
        "surface point": points,
        "bounce pair": (count**2 if dense else 64 * count) * (settings.bounces + 1),
    }


def stored_path() -> Path:
    """Where the prices of this machine lie."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "torchradiometry" / f"prices-{torch.get_num_threads()}-threads.json"


def stored_costs() -> Costs:
    """The stored prices of this machine, or those of an ordinary one."""
    try:
        return Costs.load(stored_path())
    except (FileFormatError, OSError):
        return Costs()


@torch.no_grad()
def calibrate(
    store: str | Path | None = None, progress: Callable[[float], None] = lambda share: None
) -> Costs:
    """Fit this machine's prices to a few small pictures; takes some seconds.

    Args:
        store: where to keep them; None: where `stored_costs` looks.
        progress: called with the share that is done.
    """
    rows: list[tuple[dict[str, float], dict[str, float]]] = []
    for number, (name, size, settings) in enumerate(TRIALS):
        scene = STANDARD_SCENES[name](size, size * 3 // 4)
        view_scene(scene, scene.cameras[0], replace(settings, patch_size=None, bounces=0))
        view = view_scene(scene, scene.cameras[0], settings)
        pilot = Pilot(scene, scene.cameras[0])
        rows.append((counts(pilot, settings), develop(view, scene).seconds))
        progress((number + 1) / len(TRIALS))
    prices: dict[str, float] = {}
    for stage, causes in STAGES.items():
        fitted = _fitted(
            torch.tensor([[found[c] for c in causes] for found, _ in rows], dtype=torch.float64),
            torch.tensor([seconds[stage] for _, seconds in rows], dtype=torch.float64),
            torch.tensor([DEFAULT[c] for c in causes], dtype=torch.float64),
        )
        prices |= dict(zip(causes, fitted.tolist(), strict=True))
    costs = Costs(prices, True)
    costs.save(store or stored_path())
    return costs


def _fitted(count: torch.Tensor, seconds: torch.Tensor, first: torch.Tensor) -> torch.Tensor:
    """Prices > 0 with the least squares of logarithms, drawn weakly to the default's proportions.

    sum (log predicted / measured)^2 + WEAKLY sum (log price / (c default))^2
    """
    some = (seconds > 0) & (count @ first > 0)
    count, target = count[some], seconds[some].log()
    start = (target - (count @ first).log()).median()
    change = torch.zeros_like(first).requires_grad_()
    steps = torch.optim.LBFGS([change], max_iter=200, line_search_fn="strong_wolfe")

    def limited(value: torch.Tensor) -> torch.Tensor:
        return FARTHEST * torch.tanh(value / FARTHEST)

    def loss() -> torch.Tensor:
        steps.zero_grad()
        predicted = (count @ (first * (start + limited(change)).exp())).log()
        value = (predicted - target).square().sum() + WEAKLY * change.square().sum()
        value.backward()
        return value

    with torch.enable_grad():
        steps.step(loss)
    known = (count > 0).any(0)
    return torch.where(known, first * (start + limited(change)).exp(), first).detach()
