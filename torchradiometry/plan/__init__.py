"""HOW MUCH IS ENOUGH: from a scene and a tolerance to settings with a predicted error."""

from torchradiometry.plan.pilot import mutual_view, reflected_share
from torchradiometry.plan.render_file import render_file
from torchradiometry.plan.render_plan import RenderPlan, plan_render

__all__ = ["RenderPlan", "mutual_view", "plan_render", "reflected_share", "render_file"]
