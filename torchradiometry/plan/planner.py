"""From a scene and a tolerance, or a time, to the cheapest plan: one path from best to cheapest.

    start with every effect at its best level
    repeat: of all steps to a weaker level take the one with the least
            (error added) / (seconds saved)

Steps that add no error are taken first, whatever they save: an effect that the scene does not call
for is never computed. The path does not depend on the tolerance. A tolerance picks the last plan on
it whose predicted error is within, a time the first one that fits; so a looser tolerance never
adds an effect.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from torchradiometry.errors import EmptySceneError, OutOfRangeError, require_kind
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.plan.costs import Costs, stored_costs
from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.effects import EFFECTS
from torchradiometry.plan.pilot import Pilot
from torchradiometry.plan.plan import Plan, PlannedLevel, PlanRow, merged_settings, needs_met
from torchradiometry.render.settings import RenderSettings
from torchradiometry.scene.scene import Scene
from torchradiometry.sources.polygon import PolygonSource
from torchradiometry.sources.sphere import SphereSource

__all__ = ["Planner"]


class Planner:
    """Plans pictures for a tolerance, or for a time.

    Args:
        tolerance: relative L1 error of the picture, 0 < tolerance < 1.
        seconds: time that the picture may take instead; the best picture in it is planned.
        effects: to choose among.
        costs: prices; None: those stored for this machine.
        seed: of the pilot's pixels.

    Raises:
        OutOfRangeError: neither or both of tolerance and seconds, or out of range.
        DTypeError: a seed that is no whole number.
    """

    def __init__(
        self,
        tolerance: float | None = None,
        *,
        seconds: float | None = None,
        effects: tuple[AbstractEffect, ...] = EFFECTS,
        costs: Costs | None = None,
        seed: int = 0,
    ) -> None:
        if (tolerance is None) == (seconds is None):
            raise OutOfRangeError(
                "tolerance, seconds", f"{tolerance}, {seconds}", "pass one of the two"
            )
        if tolerance is not None and not (
            isinstance(tolerance, (int, float)) and 0 < tolerance < 1
        ):
            raise OutOfRangeError("tolerance", f"{tolerance!r}", "pass a number between 0 and 1")
        if seconds is not None and not (isinstance(seconds, (int, float)) and seconds > 0):
            raise OutOfRangeError("seconds", f"{seconds!r}", "pass a time above 0")
        require_kind("seed", seed, int, "whole number")
        self.tolerance, self.seconds = tolerance, seconds
        self.effects, self.seed = effects, seed
        self.costs = stored_costs() if costs is None else costs

    def plan(self, scene: Scene, camera: AbstractCamera | None = None) -> Plan:
        """The cheapest plan of the path that meets the goal.

        Args:
            scene: surfaces and sources.
            camera: who looks; what it does not see counts only by the light it sends. None: all
                surfaces count by their area.

        Returns:
            A plan. Where no plan meets the goal it is the best one, or the cheapest, and `notes`
            say so.

        Raises:
            EmptySceneError: no triangle.
            DTypeError: no scene, or no camera (a tuple of cameras).
        """
        require_kind("scene", scene, Scene)
        if camera is not None:
            require_kind("camera", camera, AbstractCamera, "camera, such as scene.cameras[0]")
        if not any(surface.count for surface in scene.surfaces):
            raise EmptySceneError("scene", "no triangles", "add a surface with faces")
        search = _Search(Pilot(scene, camera, self.seed), self.effects, self.costs)
        path = search.path()
        if self.tolerance is not None:
            fits = [state for state in path if search.error(state) <= self.tolerance]
            state = fits[-1] if fits else path[0]
        else:
            fits = [state for state in path if search.seconds(state) <= (self.seconds or 0)]
            state = fits[0] if fits else path[-1]
        return self._described(search, state, bool(fits))

    def _described(self, search: _Search, state: State, met: bool) -> Plan:
        pilot, settings = search.pilot, search.settings(state)
        rows = []
        for k, effect in enumerate(self.effects):
            levels = tuple(
                PlannedLevel(
                    level.name,
                    level.error,
                    level.kind,
                    search.seconds((*state[:k], n, *state[k + 1 :])),
                    dict(level.settings),
                )
                for n, level in enumerate(search.levels[k])
            )
            applies = needs_met(effect.needs, settings)
            why = effect.why(pilot, search.levels[k][state[k]]) if applies else "nothing to do"
            rows.append(
                PlanRow(effect.name, effect.adds, effect.needs, applies, state[k], levels, why)
            )
        plan = Plan(
            tuple(rows),
            self.tolerance,
            self.seconds,
            search.seconds(state),
            self.costs.calibrated,
            scene=pilot.scene,
            camera=pilot.camera,
        )
        return replace(plan, notes=_notes(pilot, plan, met))


State = tuple[int, ...]


class _Search:
    """Levels of all effects, and what a choice of them costs."""

    def __init__(self, pilot: Pilot, effects: tuple[AbstractEffect, ...], costs: Costs) -> None:
        self.pilot, self.effects, self.costs = pilot, effects, costs
        self.levels: list[tuple[Level, ...]] = [effect.levels(pilot) for effect in effects]
        self._known: dict[State, tuple[float, float]] = {}

    def settings(self, state: State) -> RenderSettings:
        """Of all levels together."""
        chosen = zip(self.levels, state, strict=True)
        return merged_settings(levels[n].settings for levels, n in chosen)

    def error(self, state: State) -> float:
        """Sum over the effects that apply."""
        return self._found(state)[0]

    def seconds(self, state: State) -> float:
        """Predicted."""
        return self._found(state)[1]

    def _found(self, state: State) -> tuple[float, float]:
        if state not in self._known:
            settings = self.settings(state)
            chosen = zip(self.effects, self.levels, state, strict=True)
            left = (levels[n].error for e, levels, n in chosen if needs_met(e.needs, settings))
            seconds = self.costs.seconds(self.pilot, settings)
            self._known[state] = sum(left), sum(seconds.values())
        return self._known[state]

    def path(self) -> list[State]:
        """From the best state to the cheapest, error never falling."""
        state = tuple(len(levels) - 1 for levels in self.levels)
        found = [state]
        while (step := self._step(state)) is not None:
            state = step.state
            found.append(state)
        return found

    def _step(self, state: State) -> _Step | None:
        """The step to a weaker level that adds least error for the time it saves."""
        error, seconds = self.error(state), self.seconds(state)
        steps = []
        for k, n in enumerate(state):
            for weaker in range(n):
                to = (*state[:k], weaker, *state[k + 1 :])
                added, saved = self.error(to) - error, seconds - self.seconds(to)
                if added <= 0:
                    steps.append(_Step(-1.0, -saved, to))
                elif saved > 0:
                    steps.append(_Step(added / saved, -saved, to))
        return min(steps, default=None)


class _Step(NamedTuple):
    """A move along the path; the smallest is taken."""

    price: float
    saved: float
    state: State


def _notes(pilot: Pilot, plan: Plan, met: bool) -> tuple[str, ...]:
    notes = []
    if pilot.camera is not None and pilot.seen == 0:
        notes.append("the camera sees no surface: there is nothing to compute")
    elif pilot.light <= 0:
        notes.append("no light reaches what is seen: the picture is black")
    wide = [
        source
        for source in pilot.scene.sources
        if isinstance(source, PolygonSource)
        or (isinstance(source, SphereSource) and source.samples == 1)
    ]
    if wide and plan.settings.shadow_samples:
        notes.append(
            "sphere and polygon lamps cast hard shadows, and no error is predicted for that: "
            "make them shining surfaces for penumbras"
        )
    if not met and plan.tolerance is not None:
        notes.append(
            f"the tolerance is not reached: the best plan leaves {plan.predicted_error:.2%}"
        )
    if not met and plan.budget is not None:
        notes.append(f"even the cheapest plan takes {plan.predicted_seconds:.2g} s")
    return tuple(notes)
