"""HOW MUCH IS ENOUGH: from a scene and a tolerance to the effects it calls for."""

from torchradiometry.plan.costs import Costs, calibrate, stored_costs
from torchradiometry.plan.depth_planner import DepthPlan, DepthPlanner, PlannedDepthShading
from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.effects import (
    EFFECTS,
    CastShadows,
    ColourBleeding,
    FallOff,
    Interreflection,
    PatchSize,
    Penumbra,
    SourceExtent,
    SpecularLobe,
    Supersampling,
)
from torchradiometry.plan.ladder import Rung, ladder
from torchradiometry.plan.pilot import Pilot
from torchradiometry.plan.plan import Plan, PlannedLevel, PlanRow
from torchradiometry.plan.planner import Planner
from torchradiometry.plan.render_file import open_scene, plan_file, render_file
from torchradiometry.plan.shader import (
    AmbientLight,
    DirectLight,
    LobeLight,
    PlannedShader,
    ReflectedLight,
)
from torchradiometry.plan.tradeoff import Measured, Tradeoff, tradeoff
from torchradiometry.plan.tradeoff_file import tradeoff_file

__all__ = [
    "EFFECTS",
    "AbstractEffect",
    "AmbientLight",
    "CastShadows",
    "ColourBleeding",
    "Costs",
    "DepthPlan",
    "DepthPlanner",
    "DirectLight",
    "FallOff",
    "Interreflection",
    "Level",
    "LobeLight",
    "Measured",
    "PatchSize",
    "Penumbra",
    "Pilot",
    "Plan",
    "PlanRow",
    "PlannedDepthShading",
    "PlannedLevel",
    "PlannedShader",
    "Planner",
    "ReflectedLight",
    "Rung",
    "SourceExtent",
    "SpecularLobe",
    "Supersampling",
    "Tradeoff",
    "calibrate",
    "ladder",
    "open_scene",
    "plan_file",
    "render_file",
    "stored_costs",
    "tradeoff",
    "tradeoff_file",
]
