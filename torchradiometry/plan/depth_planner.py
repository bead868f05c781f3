"""From depth maps and a tolerance to what each of them calls for.

A training set holds images that shadows and interreflection hardly touch, and others that are made
of them. `DepthPlanner` looks at each (`depth_pilot`) and leaves out what does not matter:

    start with every effect at its best
    repeat: of all steps to a weaker level take the one with the least (error added) / (price saved)

Steps that add no error come first. The path does not depend on the tolerance, so a looser one never
adds an effect. `DepthPlan.build` runs every image with its own effects and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import (
    FileFormatError,
    IndexRangeError,
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
)
from torchradiometry.files import read_json
from torchradiometry.materials.lobes import AbstractLobe
from torchradiometry.materials.phong import Phong
from torchradiometry.places import atomic_path
from torchradiometry.plan.depth_pilot import DepthLevel, DepthMaps, depth_levels
from torchradiometry.shade.depth_map import DepthSettings, ShadeDepth
from torchradiometry.shade.layout import chosen_sources
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["DepthPlan", "DepthPlanner", "PlannedDepthShading"]


class DepthPlanner:
    """Plans the shading of depth maps for a tolerance.

    Args:
        tolerance: relative L1 error of a picture, 0 < tolerance < 1.

    Raises:
        OutOfRangeError: a tolerance outside its range.

    >>> from torchradiometry.sources.directional import DirectionalSource
    >>> flat, grey = torch.ones(1, 1, 16, 16), torch.full((1, 1, 16, 16), 0.5)
    >>> lamp = DirectionalSource([0.0, 0.6, 0.8], [1.0])
    >>> plan = DepthPlanner(0.01).plan(flat, grey, lamp, pixel_size=0.1)
    >>> plan.settings[0].cast_shadows, plan.settings[0].bounces
    (False, 0)
    """

    def __init__(self, tolerance: float) -> None:
        if not (isinstance(tolerance, (int, float)) and 0 < tolerance < 1):
            raise OutOfRangeError("tolerance", f"{tolerance!r}", "pass a number between 0 and 1")
        self.tolerance = float(tolerance)

    def plan(
        self,
        depth: Float[Tensor, "B 1 H W"],
        albedo: Float[Tensor, "B C H W"],
        sources: AbstractSource | Sequence[AbstractSource],
        intrinsics: Float[Tensor, "B 3 3"] | None = None,
        pixel_size: float | None = None,
        specular: Float[Tensor, "B C H W"] | None = None,
        shininess: Float[Tensor, "B 1 H W"] | None = None,
        lobe: type[AbstractLobe] = Phong,
    ) -> DepthPlan:
        """What each image calls for; arguments as of `ShadeDepth`.

        Returns:
            A plan. Where its best is not good enough, `notes` say so.

        Raises:
            InvalidValueError: NaN or infinite albedo, specular or shininess where depth is seen:
                no error can be foretold.
        """
        lights = chosen_sources([], sources)
        maps = DepthMaps(depth, albedo, lights, intrinsics, pixel_size, specular, shininess, lobe)
        images = depth_levels(maps)
        for name in ("albedo", "specular", "shininess"):
            _require_finite(name, getattr(maps, name), torch.isfinite(depth))
        chosen = [_last_within(list(levels.values()), self.tolerance) for levels in images]
        rows = tuple(
            tuple(
                DepthRow(effect, state, options)
                for (effect, options), state in zip(levels.items(), states, strict=True)
            )
            for levels, states in zip(images, chosen, strict=True)
        )
        return DepthPlan(rows, self.tolerance)


def _require_finite(name: str, image: Tensor | None, seen: Tensor) -> None:
    if image is not None:
        bad = int((seen & ~torch.isfinite(image)).sum())
        if bad:
            got = f"{bad} NaN or infinite values where depth is seen"
            raise InvalidValueError(name, got, "pass finite numbers")


def _last_within(effects: list[tuple[DepthLevel, ...]], tolerance: float) -> list[int]:
    """The last state of the path from best to cheapest whose error is within."""
    state = [len(levels) - 1 for levels in effects]
    best = list(state)

    def error(at: list[int]) -> float:
        return sum(levels[n].error for levels, n in zip(effects, at, strict=True))

    while True:
        steps = []
        for k, n in enumerate(state):
            for weaker in range(n):
                added = effects[k][weaker].error - effects[k][n].error
                saved = effects[k][n].price - effects[k][weaker].price
                if added <= 0 or saved > 0:
                    steps.append((added / saved if added > 0 else -1.0, -saved, k, weaker))
        if not steps:
            return best
        _, _, k, weaker = min(steps)
        state = [*state[:k], weaker, *state[k + 1 :]]
        if error(state) <= max(tolerance, error(best)):
            best = state
        else:
            return best


@dataclass(frozen=True)
class DepthRow:
    """One effect in one image.

    Attributes:
        effect: its name.
        chosen: index among `levels`.
        levels: all ways to treat it, weakest first.
    """

    effect: str
    chosen: int
    levels: tuple[DepthLevel, ...]

    @property
    def level(self) -> DepthLevel:
        """As chosen."""
        return self.levels[self.chosen]


@dataclass(frozen=True)
class DepthPlan:
    """What each image of a batch calls for.

    Attributes:
        rows: for every image, a row for every effect.
        tolerance: that was asked for.
    """

    rows: tuple[tuple[DepthRow, ...], ...]
    tolerance: float

    @property
    def settings(self) -> tuple[DepthSettings, ...]:
        """For every image."""
        found = []
        for rows in self.rows:
            merged: dict[str, Any] = {}
            for row in rows:
                merged |= row.level.settings
            found.append(DepthSettings(**merged))
        return tuple(found)

    @property
    def predicted_error(self) -> tuple[float, ...]:
        """Relative L1 error of every image, as the sum of what its levels leave."""
        return tuple(sum(row.level.error for row in rows) for rows in self.rows)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader must know."""
        late = [k for k, error in enumerate(self.predicted_error) if error > self.tolerance]
        if not late:
            return ()
        worst = max(self.predicted_error)
        return (f"the tolerance is not reached in images {late}: up to {worst:.2%} is left",)

    def table(self) -> str:
        """For every image and effect: what was chosen, and what it and leaving it out leave."""
        lines = [f"{'image':>5}  {'effect':18}{'chosen':32}{'leaves':>9}{'left out':>10}  kind"]
        for image, rows in enumerate(self.rows):
            for row in rows:
                level = row.level
                lines.append(
                    f"{image:>5}  {row.effect:18}{level.name:32}{level.error:>9.2%}"
                    f"{row.levels[0].error:>10.2%}  {row.levels[0].kind}"
                )
        return "\n".join([*lines, *self.notes])

    def overridden(self, effect: str, level: int, image: int | None = None) -> DepthPlan:
        """The plan with an effect at another level, in one image or in all that have the level.

        Raises:
            IndexRangeError: no such effect, level or image.
        """
        chosen = range(len(self.rows)) if image is None else [image]
        if image is not None and not 0 <= image < len(self.rows):
            raise IndexRangeError("image", f"{image}", f"pass 0..{len(self.rows) - 1}")
        rows = [list(found) for found in self.rows]
        changed = False
        for at in chosen:
            for k, row in enumerate(rows[at]):
                if row.effect == effect and 0 <= level < len(row.levels):
                    rows[at][k], changed = replace(row, chosen=level), True
        if not changed:
            names = ", ".join(row.effect for row in self.rows[0]) if self.rows else "none"
            raise IndexRangeError("effect, level", f"{effect!r}, {level}", f"choose among {names}")
        return replace(self, rows=tuple(tuple(found) for found in rows))

    def build(
        self,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        *,
        lobe: type[AbstractLobe] = Phong,
        pixel_size: float | None = None,
    ) -> PlannedDepthShading:
        """A layer that shades every image with its own effects; arguments as of `ShadeDepth`."""
        return PlannedDepthShading(self.settings, sources, lobe=lobe, pixel_size=pixel_size)

    def to_dict(self) -> dict[str, Any]:
        """As JSON holds it."""
        images = [
            [
                {
                    "effect": row.effect,
                    "chosen": row.chosen,
                    "levels": [level._asdict() for level in row.levels],
                }
                for row in rows
            ]
            for rows in self.rows
        ]
        settings = [asdict(settings) for settings in self.settings]
        return {"tolerance": self.tolerance, "images": images, "settings": settings}

    def save(self, path: str | Path) -> Path:
        """As JSON."""
        with atomic_path(Path(path)) as partial:
            partial.write_text(json.dumps(self.to_dict(), indent=1))
        return Path(path)

    @classmethod
    def load(cls, path: str | Path) -> DepthPlan:
        """A plan that `save` wrote.

        Raises:
            FileFormatError: another file.
        """
        found = read_json(path, "plan of depth maps")
        try:
            rows = tuple(
                tuple(
                    DepthRow(
                        str(row["effect"]),
                        int(row["chosen"]),
                        tuple(DepthLevel(**level) for level in row["levels"]),
                    )
                    for row in image
                )
                for image in found["images"]
            )
            plan = cls(rows, float(found["tolerance"]))
            _ = plan.settings
        except (ValueError, LookupError, TypeError, ArithmeticError, AttributeError) as error:
            mend = "pass a file that DepthPlan.save wrote"
            raise FileFormatError(str(path), f"no plan of depth maps ({error})", mend) from error
        return plan


@final
class PlannedDepthShading(nn.Module):
    """Image layer: every image of a batch with its own effects, and nothing else computed.

    Images with the same settings are shaded together. Where they differ, sources must serve all
    images (no batch axis).

    Args:
        settings: of every image of the batch.
        sources, lobe, pixel_size: as of `ShadeDepth`.
    """

    def __init__(
        self,
        settings: Sequence[DepthSettings],
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        *,
        lobe: type[AbstractLobe] = Phong,
        pixel_size: float | None = None,
    ) -> None:
        super().__init__()
        distinct = list(dict.fromkeys(settings))
        self.groups = [[k for k, own in enumerate(settings) if own == one] for one in distinct]
        self.images = len(settings)
        held = None if sources is None else chosen_sources([], sources)
        self.layers = nn.ModuleList(
            ShadeDepth(one, held, lobe=lobe, pixel_size=pixel_size) for one in distinct
        )

    def forward(
        self,
        depth: Float[Tensor, "B 1 H W"],
        albedo: Float[Tensor, "B C H W"],
        intrinsics: Float[Tensor, "B 3 3"] | None = None,
        specular: Float[Tensor, "B C H W"] | None = None,
        shininess: Float[Tensor, "B 1 H W"] | None = None,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
    ) -> Float[Tensor, "B C H W"]:
        """Radiance `B C H W` in W/m2/sr; arguments as of `ShadeDepth`.

        Raises:
            ShapeError: another number of images than was planned.
        """
        if len(depth) != self.images:
            got, mend = f"{len(depth)} images", f"pass the {self.images} that were planned"
            raise ShapeError("depth", got, mend)
        if len(self.groups) == 1:
            return self.layers[0](depth, albedo, intrinsics, specular, shininess, sources)

        def of(image: Tensor | None, group: list[int], single: int = 4) -> Tensor | None:
            shared = image is None or image.ndim < single or len(image) == 1
            return image if shared else image[group]  # type: ignore[index]

        found = []
        for group, layer in zip(self.groups, self.layers, strict=True):
            maps = (of(image, group) for image in (depth, albedo))
            rest = (of(specular, group), of(shininess, group), sources)
            found.append(layer(*maps, of(intrinsics, group, 3), *rest))
        order = torch.tensor([k for group in self.groups for k in group], device=depth.device)
        return torch.cat(found)[order.argsort()]
