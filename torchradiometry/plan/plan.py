"""A plan: which effects a picture needs, why, what it will cost, and what error to expect.

A plan is data. It prints as a table, goes to JSON and comes back, and can be overruled effect by
effect; `predicted_error` is the sum of what the chosen levels leave, and the picture's relative L1
error is meant to be at most that.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from torchradiometry.errors import (
    EmptySceneError,
    FileFormatError,
    IndexRangeError,
    OutOfRangeError,
)
from torchradiometry.files import read_json
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.places import atomic_path
from torchradiometry.plan.shader import PlannedShader
from torchradiometry.render.settings import RenderSettings
from torchradiometry.scene.scene import Scene

__all__ = ["Plan", "PlanRow", "PlannedLevel", "merged_settings", "needs_met"]


def merged_settings(parts: Iterable[Mapping[str, Any]]) -> RenderSettings:
    """Settings of several effects together: the later decides, but never switches shadows on."""
    merged: dict[str, Any] = {}
    for part in parts:
        off = merged.get("shadow_samples") == 0
        merged |= {k: v for k, v in part.items() if not (off and k == "shadow_samples")}
    return RenderSettings(**merged)


def needs_met(needs: Iterable[str], settings: RenderSettings) -> bool:
    """Whether none of the named settings is 0 or False."""
    return all(getattr(settings, name) for name in needs)


@dataclass(frozen=True)
class PlannedLevel:
    """One way to treat an effect.

    Attributes:
        name: `left out`, `8 bounces`...
        error: relative L1 error that remains.
        kind: `exact`, `bound` or `estimate`.
        seconds: of the whole picture with this level, all else as planned.
        settings: of the renderer.
    """

    name: str
    error: float
    kind: str
    seconds: float
    settings: dict[str, Any]


@dataclass(frozen=True)
class PlanRow:
    """One effect.

    Attributes:
        effect: its name.
        adds: what it adds.
        needs: settings without which it has nothing to do.
        applies: whether the chosen settings give it something to do.
        chosen: index among `levels`, weakest first.
        levels: all ways to treat it.
        why: the reason, one clause.
    """

    effect: str
    adds: str
    needs: tuple[str, ...]
    applies: bool
    chosen: int
    levels: tuple[PlannedLevel, ...]
    why: str

    @property
    def level(self) -> PlannedLevel:
        """What was chosen."""
        return self.levels[self.chosen]

    @property
    def included(self) -> bool:
        """The effect is not left out."""
        return self.applies and self.chosen > 0

    @property
    def error(self) -> float:
        """Relative L1 error that remains."""
        return self.level.error if self.applies else 0.0

    @property
    def left_out(self) -> PlannedLevel:
        """What leaving it out would cost and save."""
        return self.levels[0]


@dataclass(frozen=True)
class Plan:
    """Effects, settings, predictions.

    Attributes:
        rows: one an effect.
        tolerance: relative L1 error that was asked for; None if a time was.
        budget: seconds that were asked for; None if a tolerance was.
        predicted_seconds: of the picture.
        calibrated: the seconds are of this machine.
        notes: what else to know, such as a tolerance that cannot be reached.
        scene, camera: what was planned; not saved.
    """

    rows: tuple[PlanRow, ...]
    tolerance: float | None
    budget: float | None
    predicted_seconds: float
    calibrated: bool
    notes: tuple[str, ...] = ()
    scene: Scene | None = field(default=None, compare=False, repr=False)
    camera: AbstractCamera | None = field(default=None, compare=False, repr=False)

    @property
    def predicted_error(self) -> float:
        """Sum of what the chosen levels leave: the picture's error should not exceed it."""
        return sum(row.error for row in self.rows)

    @property
    def settings(self) -> RenderSettings:
        """What `render_scene` takes."""
        return merged_settings(row.level.settings for row in self.rows)

    def row(self, effect: str) -> PlanRow:
        """The row of an effect, by name.

        Raises:
            IndexRangeError: no such effect.
        """
        for row in self.rows:
            if row.effect == effect:
                return row
        names = ", ".join(row.effect for row in self.rows)
        raise IndexRangeError("effect", repr(effect), f"use one of {names}")

    def overridden(self, effect: str, level: str | int) -> Plan:
        """The plan with another level of one effect, chosen by name or index.

        The predicted seconds change by what that level alone would change.

        Raises:
            IndexRangeError, OutOfRangeError: no such effect or level.
        """
        row = self.row(effect)
        names = [each.name for each in row.levels]
        index = names.index(level) if level in names else level
        if not isinstance(index, int) or not -len(names) <= index < len(names):
            raise OutOfRangeError("level", repr(level), f"use one of {', '.join(names)}")
        changed = replace(row, chosen=index % len(names), why="as asked")
        seconds = self.predicted_seconds + changed.level.seconds - row.level.seconds
        rows = tuple(changed if r is row else r for r in self.rows)
        settings = merged_settings(r.level.settings for r in rows)
        rows = tuple(replace(r, applies=needs_met(r.needs, settings)) for r in rows)
        return replace(self, rows=rows, predicted_seconds=max(seconds, 0.0))

    def build(
        self, scene: Scene | None = None, camera: AbstractCamera | None = None
    ) -> PlannedShader:
        """A shader that holds what the plan chose and runs nothing else.

        Args:
            scene, camera: None: those that were planned.

        Raises:
            EmptySceneError: a plan without a scene or camera of its own, and none given.
        """
        scene, camera = scene or self.scene, camera or self.camera
        if scene is None or camera is None:
            what = "scene" if scene is None else "camera"
            raise EmptySceneError(what, "None", f"pass the {what} to `build`")
        names = tuple(row.effect for row in self.rows if row.included)
        return PlannedShader(scene, camera, self.settings, names)

    def table(self) -> str:
        """The plan as text, one line an effect."""
        lines = [("effect", "chosen", "error left", "if left out", "kind", "why")]
        for row in self.rows:
            chosen = row.level.name if row.applies else "not needed"
            out = row.left_out
            cells = (row.effect, chosen, f"{row.error:.2%}", f"{out.error:.2%}", out.kind, row.why)
            lines.append(cells)
        widths = [max(len(line[k]) for line in lines) for k in range(6)]
        shown = [
            "  ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)).rstrip()
            for line in lines
        ]
        goal = f"tolerance {self.tolerance:.2%}" if self.tolerance else f"{self.budget:g} s"
        price = "" if self.calibrated else " (prices of an ordinary core: calibrate this machine)"
        error, seconds = f"{self.predicted_error:.2%}", f"{self.predicted_seconds:.2g} s"
        total = f"{goal}: predicted error {error}, {seconds}{price}"
        return "\n".join([*shown, total, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and dicts, for JSON."""
        bare = replace(self, scene=None, camera=None)
        kept = {k: v for k, v in asdict(bare).items() if k not in ("scene", "camera")}
        return kept | {
            "predicted_error": self.predicted_error,
            "settings": {k: v for k, v in asdict(self.settings).items() if k != "rays"},
        }

    def save(self, path: str | Path) -> None:
        """Write the plan to a JSON file."""
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(self.to_dict(), indent=1))

    @classmethod
    def load(cls, path: str | Path) -> Plan:
        """Read what `save` wrote.

        Raises:
            InputFileError, FileFormatError: no such file, or no plan in it.
        """
        try:
            return cls.from_dict(read_json(path, "plan"))
        except (ValueError, LookupError, TypeError, ArithmeticError, AttributeError) as error:
            raise FileFormatError(str(path), "no plan", "save one with `Plan.save`") from error

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> Plan:
        """The plan that `to_dict` described."""
        rows = tuple(
            PlanRow(
                **{
                    **row,
                    "needs": tuple(row["needs"]),
                    "levels": tuple(PlannedLevel(**level) for level in row["levels"]),
                }
            )
            for row in found["rows"]
        )
        plan = cls(
            rows,
            found["tolerance"],
            found["budget"],
            found["predicted_seconds"],
            found["calibrated"],
            tuple(found["notes"]),
        )
        _ = plan.settings, plan.predicted_error
        return plan
