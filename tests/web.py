"""Node, Chromium and the packages of `web/`: found, or the test is skipped (never under CI)."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

WEB = Path(__file__).resolve().parents[1] / "web"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: no script here takes longer, even beside other work
SECONDS = 400


def missing(*, browser: bool) -> str | None:
    """What is not installed, in words."""
    if shutil.which("node") is None:
        return "node is not installed"
    if not (WEB / "node_modules" / "onnxruntime-web").is_dir():
        return "the packages of web/ are not installed: run npm ci --ignore-scripts there"
    wanted = os.environ.get("CHROMIUM") or next(filter(shutil.which, BROWSERS), None)
    if browser and wanted is None:
        return "Chromium is not installed"
    return None


def require(*, browser: bool) -> None:
    """Skip where something is missing; fail where CI is set."""
    reason = missing(browser=browser)
    if reason and os.environ.get("CI"):
        pytest.fail(f"{reason}; .ci/run installs it")
    if reason:
        pytest.skip(reason)


def run_script(name: str, *arguments: object) -> Any:
    """What a script of `web/` prints, as JSON."""
    done = subprocess.run(
        ["node", str(WEB / name), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return json.loads(done.stdout)
