"""Shared fixtures: where the benchmark data lies, whether OpenGL works, one seeded generator."""

import os
from pathlib import Path

import pytest
import torch
from hypothesis import settings

# the same examples in every run; HYPOTHESIS_PROFILE=search draws new ones
settings.register_profile("repeatable", deadline=None, derandomize=True, database=None)
settings.register_profile("search", deadline=None, max_examples=1000)
# `pytest --thorough`: 10,000 examples of every invariant
settings.register_profile("thorough", settings.get_profile("repeatable"), max_examples=10_000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(20260101)


@pytest.fixture
def benchmark_data() -> Path:
    if not DATA.is_dir():
        pytest.skip("the benchmark data folder is not beside this repository")
    return DATA


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--thorough", action="store_true", help="every test, and 10,000 examples of every invariant"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked `thorough` unless asked for."""
    if not config.getoption("thorough"):
        left_out = [item for item in items if item.get_closest_marker("thorough")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("thorough")]


def pytest_configure(config: pytest.Config) -> None:
    """Two test workers share two cores: one torch thread each."""
    if config.getoption("thorough"):
        settings.load_profile("thorough")
    if os.environ.get("PYTEST_XDIST_WORKER"):
        torch.set_num_threads(1)
