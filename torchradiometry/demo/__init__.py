"""THE MAIN JOB: one command from a mesh to normals of real photographs."""

from torchradiometry.demo.run import run_demo

__all__ = ["run_demo"]
