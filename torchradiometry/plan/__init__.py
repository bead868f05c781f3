"""HOW MUCH IS ENOUGH: from a scene and a tolerance to settings with a predicted error."""

from torchradiometry.plan.render_file import render_file
from torchradiometry.plan.render_plan import RenderPlan, plan_render

__all__ = ["RenderPlan", "plan_render", "render_file"]
