"""The runtimes that our ONNX files are run by: each takes a file and arrays, and gives arrays.

Node and Chromium are kept open as processes that read a job a line (`web/job.mjs`).
"""

from __future__ import annotations

import base64
import json
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.web import WEB
from torchradiometry.deploy.runtime import open_model, run_model
from torchradiometry.errors import RadiometryError

Arrays = Mapping[str, NDArray[Any]]


class Answer(NamedTuple):
    """Outputs in order and the times of further runs in ms; or what went wrong, in words."""

    outputs: list[NDArray[Any]]
    times: list[float]
    error: str | None = None


class Python:
    """onnxruntime in this process, one thread."""

    def __init__(self) -> None:
        import onnxruntime

        self.about = f"onnxruntime {onnxruntime.__version__}, Python"

    def run(self, path: Path, inputs: Arrays, repeats: int, seconds: float) -> Answer:
        try:
            model = open_model(path, threads=1)
            used = {item.name: inputs[item.name] for item in model.inputs}
            outputs = list(run_model(model, used))
        except RadiometryError as error:
            return Answer([], [], str(error))
        times: list[float] = []
        end = time.perf_counter() + seconds
        while len(times) < repeats and (len(times) < 3 or time.perf_counter() < end):
            began = time.perf_counter()
            model.session.run(None, used)
            times.append(1e3 * (time.perf_counter() - began))
        return Answer(outputs, times)

    def close(self) -> None: ...


class Script:
    """A script of `web/` that answers jobs, such as `run_node.mjs` or `run_browser.mjs`."""

    def __init__(self, name: str) -> None:
        self.process = subprocess.Popen(
            ["node", str(WEB / name)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        hello = self._read()
        self.about = f"{hello['runtime']} {hello['version']}, {hello['host']}"

    def run(self, path: Path, inputs: Arrays, repeats: int, seconds: float) -> Answer:
        job = {
            "model": base64.b64encode(path.read_bytes()).decode(),
            "inputs": [_encoded(name, array) for name, array in inputs.items()],
            "repeats": repeats,
            "seconds": seconds,
        }
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(job) + "\n")
        self.process.stdin.flush()
        found = self._read()
        if "error" in found:
            return Answer([], [], found["error"])
        return Answer([_decoded(output) for output in found["outputs"]], found["times"])

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(timeout=60)
        assert self.process.stdout is not None
        self.process.stdout.close()

    def _read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.process.args} ended without an answer")
        return json.loads(line)


def _encoded(name: str, array: NDArray[Any]) -> dict[str, object]:
    data = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
    return {"name": name, "type": str(array.dtype), "dims": list(array.shape), "data": data}


def _decoded(output: Mapping[str, Any]) -> NDArray[Any]:
    flat = np.frombuffer(base64.b64decode(output["data"]), np.dtype(output["type"]))
    return flat.reshape([int(size) for size in output["dims"]])
