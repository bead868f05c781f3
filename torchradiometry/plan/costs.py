"""What a picture will take: seconds by cause, from counts and this machine's prices.

    seconds = sum over causes of  price x count

Counts follow from the scene, the camera and the settings: pixels, points x shining polygons, pairs
of patches that face each other, or that something may stand between, levels of the tree of
triangles that a ray descends. Prices are fitted once per machine to the stages of a few pictures
of standard scenes, by least squares of logarithms, and stored. A machine without stored prices
gets those of an ordinary processor core.
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
from torchradiometry.files import read_json
from torchradiometry.places import atomic_path, writing
from torchradiometry.plan.pilot import Pilot
from torchradiometry.render.ambient import POINTS as SAMPLE
from torchradiometry.render.ambient import RAYS
from torchradiometry.render.indirect import MOST_DENSE
from torchradiometry.render.picture import develop, view_scene
from torchradiometry.render.settings import RenderSettings
from torchradiometry.scene.standard import STANDARD_SCENES
from torchradiometry.transport.visibility import TRIALS

__all__ = ["Costs", "calibrate", "counts", "stored_costs"]

#: seconds each on one core of an ordinary processor, in millionths
MICROSECONDS = {
    "start": 5000,
    "triangle": 0.4,
    "ray": 1.3,
    "ray level": 0.13,
    "batch": 4000,
    "lamp point": 5,
    "lit point": 6,
    "polygon point": 2.5,
    "shadow ray": 2.5,
    "clipped batch": 20000,
    "clipped view": 6,
    "clipped point": 20,
    "lobe ray": 6,
    "exchange": 30000,
    "blocked exchange": 30000,
    "patch": 400,
    "pair": 0.6,
    "facing pair": 1.2,
    "doubtful pair": 3,
    "clustered patch": 2400,
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
#: pairs of patches that see each other in part, x size of the patches as a part of the scene's
#: half diagonal, for each root of the share of pairs of points that are hidden from each other
PARTLY = 2.7
#: entries of a matrix that take as long as a patch in a tree of clusters
CLUSTERS = 12000
#: points of a patch that are lit directly
LIT = 16
#: pictures that prices are fitted to: scene, size, settings
PICTURES = (
    ("ball", 64, RenderSettings(bounces=0, shadow_samples=0)),
    ("ball", 192, RenderSettings(bounces=0, shadow_samples=0)),
    ("crate", 128, RenderSettings(bounces=0)),
    ("cornell", 64, RenderSettings(bounces=0, extent=False, shadow_samples=0)),
    ("cornell", 96, RenderSettings(bounces=0, penumbra=False)),
    ("cornell", 96, RenderSettings(bounces=0)),
    ("columns", 32, RenderSettings(bounces=0)),
    ("groove", 32, RenderSettings(patch_size=0.25, importance=True)),
    ("white room", 32, RenderSettings(patch_size=1.5, importance=True)),
    ("cornell", 32, RenderSettings(patch_size=2.0, importance=True)),
    ("cornell", 32, RenderSettings(patch_size=1.0, importance=True, bounces=16)),
    ("cornell", 16, RenderSettings(patch_size=0.7, importance=True, penumbra=False)),
    ("two rooms", 32, RenderSettings(patch_size=1.5, importance=True, bounces=48)),
    ("columns", 16, RenderSettings(patch_size=0.7, importance=True, penumbra=False)),
    ("shiny table", 32, RenderSettings(bounces=0, lobe_samples=32)),
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
        return {
            stage: sum(self.prices[cause] * count for cause, count in causes.items())
            for stage, causes in counts(pilot, settings).items()
        }

    def save(self, path: str | Path) -> None:
        """Write them to a JSON file."""
        with writing(path):
            Path(path).parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps({"prices": self.prices}, indent=1))

    @classmethod
    def load(cls, path: str | Path) -> Costs:
        """Read what `save` wrote.

        Raises:
            InputFileError, FileFormatError: no such file, or not of this kind.
        """
        remedy = "calibrate again: torchradiometry plan SCENE --calibrate"
        try:
            found = dict(read_json(path, "prices")["prices"])
            prices = {name: float(found[name]) for name in DEFAULT if name in found}
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise FileFormatError(str(path), "no prices", remedy) from error
        if lacking := [name for name in DEFAULT if name not in prices]:
            got = f"prices of another version, without {', '.join(map(repr, lacking))}"
            raise FileFormatError(str(path), got, remedy)
        if wrong := [name for name, price in prices.items() if not 0 <= price < math.inf]:
            raise FileFormatError(str(path), f"{wrong[0]!r} = {prices[wrong[0]]}", remedy)
        return cls(prices, True)


def counts(pilot: Pilot, settings: RenderSettings) -> dict[str, dict[str, float]]:
    """How often each cause occurs in each stage of a picture with `settings`."""
    camera = pilot.camera
    pixels = camera.width * camera.height if camera is not None else 0
    side, one = settings.supersampling, pilot.one_ray
    edges, bent = (2 * one.share, 2 * one.bent * side**2) if side > 1 else (0.0, 0.0)
    more = edges * (4 * side**2 + 2) + bent
    seen = pixels * max(pilot.seen, 1 / 64)
    shiny = seen * pilot.highlights.shiny * (settings.lobe_samples > 0)
    points = seen * (1 + 2 * edges) + pixels * bent + shiny * side**2 * (side > 1)
    rays = pixels * (1 + more) + shiny * side**2 * (side > 1)
    levels = math.log2(1 + len(pilot.world.triangles.surface))
    lobes = shiny * max(settings.lobe_samples, side**2)
    once = replace(settings, shadow_samples=min(1, settings.shadow_samples))
    balance = SAMPLE if settings.ambient and settings.bounces == 0 else 0
    size = settings.patch_size if settings.bounces else None
    count = pilot.patching.count(size, settings.importance) if size else 0.0
    dense = count <= MOST_DENSE
    pairs = count**2 / 2 * dense
    facing, hidden = pilot.patching.pairs(size, settings.importance) if size else (0.0, 0.0)
    # what hides some pairs hides others in part, along its edges; among many blockers no pair
    # is certain
    blockers = pilot.world.blockers
    few = blockers is not None and len(blockers) <= TRIALS * settings.pair_samples
    partly = PARTLY * math.sqrt(hidden) * (size or 0.0) / pilot.world.rays.scale
    doubtful = min(1.0, partly) if few else 1.0
    batches = 1.0 if side == 1 else 4.0
    return {
        "prepare": {"start": 1.0, "triangle": float(len(pilot.world.triangles.surface))},
        "direct": {"ray": rays, "ray level": rays * levels}
        | _lit(pilot, settings, points, batches),
        "lobes": {"lobe ray": lobes * (1 + len(pilot.world.emitters.triangle))}
        | _lit(pilot, once, lobes, float(lobes > 0), clips=False),
        "indirect": {
            "ray": float(balance * RAYS),
            "ray level": balance * RAYS * levels,
            "exchange": float(count > 0),
            "blocked exchange": float(count > 0 and hidden > 0),
            "patch": count * dense,
            "pair": pairs,
            "facing pair": pairs * facing,
            "doubtful pair": pairs * facing * doubtful,
            "clustered patch": count * (not dense),
        }
        | _lit(pilot, settings, balance + LIT * count, float(balance + count > 0)),
        "shade": {
            "picture": 1.0,
            "bounce": float(settings.bounces),
            "surface point": points + balance,
            "bounce pair": (count**2 if dense else CLUSTERS * count) * (settings.bounces + 1),
        },
    }


def _lit(
    pilot: Pilot, settings: RenderSettings, points: float, batches: float, clips: bool = True
) -> dict[str, float]:
    """What direct light on some points takes; `clips` where few blockers are cut out."""
    world, lamps = pilot.world, len(pilot.scene.sources)
    polygons, blockers = len(world.emitters.corners), world.blockers
    shaded = settings.shadow_samples > 0
    soft = settings.penumbra and settings.extent
    exact = clips and shaded and soft and blockers is not None
    clipped = polygons * len(blockers) if exact and blockers is not None else 0
    # points whose first rays disagree take three times as many more
    each = settings.shadow_samples * (1 + 3 * pilot.shaded) if soft else 1
    rays = 0 if exact else polygons * each
    return {
        "batch": batches,
        "clipped batch": batches * (clipped > 0),
        "lamp point": lamps * points * (1.0 if settings.near else 0.5),
        "lit point": points * (polygons > 0),
        "polygon point": polygons * points * (1.0 if settings.extent else 0.3),
        "shadow ray": points * shaded * (lamps + rays * pilot.facing),
        "clipped view": points * polygons * (clipped > 0),
        "clipped point": points * polygons * pilot.between if clipped > 0 else 0.0,
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
    rows: list[tuple[dict[str, float], float]] = []
    for number, (name, size, settings) in enumerate((PICTURES[0], *PICTURES)):
        scene = STANDARD_SCENES[name](size, size * 3 // 4)
        view = view_scene(scene, scene.cameras[0], settings)
        seconds = develop(view, scene).seconds
        found = counts(Pilot(scene, scene.cameras[0]), settings)
        # the first one is made twice: once to warm up
        rows += [(causes, seconds[stage]) for stage, causes in found.items() if number]
        progress((number + 1) / (len(PICTURES) + 1))
    count = [[causes.get(cause, 0.0) for cause in DEFAULT] for causes, _ in rows]
    fitted = _fitted(
        torch.tensor(count, dtype=torch.float64),
        torch.tensor([seconds for _, seconds in rows], dtype=torch.float64),
        torch.tensor(list(DEFAULT.values()), dtype=torch.float64),
    )
    costs = Costs(dict(zip(DEFAULT, fitted.tolist(), strict=True)), True)
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
    return (first * (start + limited(change)).exp()).detach()
