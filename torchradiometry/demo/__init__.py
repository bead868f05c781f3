"""WHOLE JOBS: from a mesh to normals of real photographs; training, data sets, benchmarks."""

from torchradiometry.demo.benchmark import Benchmark, run_benchmark
from torchradiometry.demo.run import run_demo
from torchradiometry.demo.trainer import dataset_folder, train_folder

__all__ = ["Benchmark", "dataset_folder", "run_benchmark", "run_demo", "train_folder"]
