"""The effect of lobes: planned where surfaces are shiny, and nowhere else."""

from dataclasses import replace

import pytest

from torchradiometry import Planner, plan, render, scene
from torchradiometry.plan.costs import Costs, counts
from torchradiometry.scene import STANDARD_SCENES

SIZE = (24, 18)


def shiny(specular: float = 0.3, shininess: float = 80.0) -> scene.Scene:
    made = STANDARD_SCENES["crate"](*SIZE)
    return replace(made, surfaces=tuple(s.shiny(specular, shininess) for s in made.surfaces))


def test_dull_surfaces_have_no_lobes() -> None:
    made = STANDARD_SCENES["crate"](*SIZE)
    pilot = plan.Pilot(made, made.cameras[0])
    (level,) = plan.SpecularLobe().levels(pilot)
    assert (level.kind, level.error, level.settings) == ("exact", 0.0, {"lobe_samples": 0})
    assert pilot.highlights.shiny == 0
    assert counts(pilot, render.RenderSettings())["lobes"]["lobe ray"] == 0


def test_highlights_are_planned_where_they_are_seen() -> None:
    made = shiny(0.3)
    found = Planner(0.1, costs=Costs()).plan(made, made.cameras[0])
    assert found.row("specular lobe").included
    assert found.settings.lobe_samples > 0
    assert found.build().lobes is not None
    faint = shiny(0.001)
    row = Planner(0.1, costs=Costs()).plan(faint, faint.cameras[0]).row("specular lobe")
    assert not row.included
    assert row.levels[0].error > 0


def test_the_measured_error_is_at_most_the_predicted_one() -> None:
    """Against many more rays; what lobes send to other surfaces is even in both."""
    for made in (shiny(0.1, 5.0), STANDARD_SCENES["shiny table"](*SIZE)):
        found = Planner(0.2, costs=Costs()).plan(made, made.cameras[0])
        fine = replace(
            found.settings, lobe_samples=256, shadow_samples=16, penumbra=True, bounces=16,
            supersampling=4, patch_size=0.4, seed=7,
        )  # fmt: skip
        truth = render.render_scene(made, made.cameras[0], fine)
        picture = render.render_scene(made, made.cameras[0], found.settings)
        off = (picture.radiance - truth.radiance)[~truth.emitter].abs().sum()
        error = float(off / truth.radiance[~truth.emitter].sum())
        assert error <= found.predicted_error <= 0.2


def test_what_lobes_send_to_other_surfaces_is_said() -> None:
    """Spread evenly at every level, and so a tolerance below it is out of reach."""
    made = STANDARD_SCENES["shiny table"](*SIZE)
    pilot = plan.Pilot(made, made.cameras[0])
    levels = plan.SpecularLobe().levels(pilot)
    spread = plan.SpecularLobe().spread(pilot)
    assert spread > 0.01
    assert all(level.error >= spread for level in levels)
    assert [level.error for level in levels] == sorted((v.error for v in levels), reverse=True)
    alone = replace(made, surfaces=(made.surfaces[0], made.surfaces[-1]))
    assert plan.SpecularLobe().spread(plan.Pilot(alone, made.cameras[0])) < spread / 10


def test_without_an_eye_there_are_no_highlights() -> None:
    found = Planner(0.3, costs=Costs()).plan(shiny(0.3))
    assert not found.row("specular lobe").included


@pytest.mark.parametrize("tolerance", [0.5, 0.1])
def test_a_looser_tolerance_asks_for_no_more_rays(tolerance: float) -> None:
    made = STANDARD_SCENES["shiny table"](*SIZE)
    planner, tighter = (Planner(t, costs=Costs()) for t in (tolerance, tolerance / 2))
    loose, tight = (p.plan(made, made.cameras[0]) for p in (planner, tighter))
    assert loose.settings.lobe_samples <= tight.settings.lobe_samples
