"""WHOLE JOBS: from a mesh to normals of photographs; training, data, benchmarks; a web page."""

from torchradiometry.demo.benchmark import Benchmark, run_benchmark
from torchradiometry.demo.measured import tradeoff_folder
from torchradiometry.demo.relighting_page import browser_page
from torchradiometry.demo.run import run_demo
from torchradiometry.demo.trainer import dataset_folder, train_folder

__all__ = [
    "Benchmark",
    "browser_page",
    "dataset_folder",
    "run_benchmark",
    "run_demo",
    "tradeoff_folder",
    "train_folder",
]
