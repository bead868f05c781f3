"""Photographs of a known scene through known cameras come back as its radiance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from torchradiometry.deploy.exposure_times import recorded_exposures
from torchradiometry.deploy.exposures import (
    calibrate_files,
    debevec_response,
    linear_response,
    merge_exposures,
    srgb_response,
)
from torchradiometry.deploy.photographs import read_photograph
from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    OutOfRangeError,
    RadiometryError,
    ShapeError,
)
from torchradiometry.files import linear_to_srgb, read_picture, write_counts, write_picture

TIMES = [1.2, 0.3, 0.075, 0.01875, 0.0046875]
#: what a count of 8 bits may be off by, as a share of a well exposed one: half of 1/64
QUANTUM = 0.5 / 64


def smoothstep(light: NDArray) -> NDArray:
    """A film-like curve with a toe and a shoulder."""
    x = np.clip(light, 0, 1) ** 0.4
    return x * x * (3 - 2 * x)


CURVES = {
    "gamma 2.2": lambda light: np.clip(light, 0, 1) ** (1 / 2.2),
    "sRGB": linear_to_srgb,
    "toe and shoulder": smoothstep,
}


def scene(height: int = 48, width: int = 64) -> NDArray[np.float64]:
    """Radiance over three decades, of three colours."""
    y, x = np.mgrid[0 : 1 : height * 1j, 0 : 1 : width * 1j]
    red = 10 ** (-1.5 + 3 * x + 0.3 * np.sin(9 * y))
    return np.stack([red, 0.7 * red * (1 + 0.3 * np.sin(7 * x)), 0.5 * red], -1)


def shot(curve: Callable[[NDArray], NDArray], full: int = 255) -> list[NDArray[np.unsignedinteger]]:
    kind = np.uint8 if full == 255 else np.uint16
    return [np.round(full * curve(scene() * t)).astype(kind) for t in TIMES]


def relative_error(found: NDArray, truth: NDArray) -> NDArray:
    """Of every value, each colour up to one factor."""
    ratio = found / truth
    return abs(ratio / np.median(ratio, axis=(0, 1)) - 1)


@pytest.mark.parametrize("name", CURVES)
def test_debevec_finds_radiance_through_an_unknown_curve(name: str) -> None:
    merged = merge_exposures(shot(CURVES[name]), TIMES, debevec_response)
    error = relative_error(merged.radiance, scene())
    assert not merged.unheld.any()
    assert error.mean() < 0.008  # measured 0.003 to 0.005
    assert np.percentile(error, 95) < 0.02  # measured 0.009 to 0.013


def test_a_known_curve_gives_radiance_itself() -> None:
    merged = merge_exposures(shot(linear_to_srgb), TIMES, srgb_response)
    np.testing.assert_allclose(merged.radiance.mean(), scene().mean(), rtol=QUANTUM)
    assert relative_error(merged.radiance, scene()).mean() < QUANTUM
    fine = merge_exposures(shot(lambda x: np.clip(x, 0, 1), 65535), TIMES, linear_response)
    np.testing.assert_allclose(fine.radiance, scene(), rtol=2e-3)


def test_what_no_exposure_holds_is_a_bound_and_is_counted() -> None:
    white, black = np.full((2, 2, 3), 255, np.uint8), np.zeros((2, 2, 3), np.uint8)
    bright = merge_exposures([white, white], [1.0, 0.25], linear_response)
    assert bright.unheld.all()
    np.testing.assert_allclose(bright.radiance, 4.0)  # at least what saturates the shortest
    dark = merge_exposures([black, black], [1.0, 0.25], linear_response)
    assert dark.unheld.all()
    np.testing.assert_array_equal(dark.radiance, 0)


def test_floats_are_linear() -> None:
    light = scene().astype(np.float32)
    merged = merge_exposures([light * t for t in TIMES], TIMES, linear_response)
    np.testing.assert_allclose(merged.radiance, light, rtol=1e-5)


def write_stack(
    folder: Path, stack: Sequence[NDArray], times: Sequence[float] | None, aperture: float = 8.0
) -> list[Path]:
    """PNG files, with exposure times in their EXIF if given."""
    folder.mkdir(exist_ok=True)
    paths = [folder / f"{k}.png" for k in range(len(stack))]
    for k, (path, counts) in enumerate(zip(paths, stack, strict=True)):
        exif = Image.Exif()
        exif[0x010F] = "a camera"
        if times is not None:
            exif.get_ifd(0x8769).update({0x829A: times[k], 0x829D: aperture, 0x8827: 100})
        Image.fromarray(counts).save(path, exif=exif)
    return paths


def test_a_folder_with_recorded_times_becomes_one_picture(tmp_path: Path) -> None:
    write_stack(tmp_path / "stack", shot(linear_to_srgb), TIMES)
    report = calibrate_files([tmp_path / "stack"], tmp_path / "scene.npy", light=[2.0, 1.0, 0.5])
    found = read_picture(tmp_path / "scene.npy")
    assert relative_error(found, scene()).mean() < 0.008
    for words in ("EXIF", "merged 5 exposures of 0.00469 to 1.2 s", "Debevec", "light's 2, 1, 0.5"):
        assert words in report["radiometry"]
    assert (report["size"], report["unheld"]) == ([48, 64], 0)
    plain = calibrate_files([tmp_path / "stack"], tmp_path / "plain.exr")
    assert "light" not in plain["radiometry"]
    per_unit = read_picture(tmp_path / "plain.exr") / np.array([2.0, 1.0, 0.5], np.float32)
    np.testing.assert_allclose(found, per_unit, rtol=1e-6)


def test_given_times_stand_in_for_recorded_ones(tmp_path: Path) -> None:
    paths = write_stack(tmp_path / "stack", shot(linear_to_srgb), None)
    with pytest.raises(InputFileError, match="no exposure time in it; pass --times"):
        calibrate_files(paths, tmp_path / "scene.npy")
    report = calibrate_files(paths, tmp_path / "scene.npy", times=TIMES, response=srgb_response)
    assert "EXIF" not in report["radiometry"]
    assert "sRGB" in report["radiometry"]
    error = relative_error(read_picture(tmp_path / "scene.npy"), scene())
    assert error.mean() < QUANTUM


def test_one_photograph_is_linearised(tmp_path: Path) -> None:
    light = np.clip(scene() * 0.2, 0.02, 0.98)
    write_counts(tmp_path / "one.png", np.round(255 * linear_to_srgb(light)).astype(np.uint8))
    report = calibrate_files([tmp_path / "one.png"], tmp_path / "one.npy")
    assert report["radiometry"] == "linearised from sRGB"
    np.testing.assert_allclose(read_picture(tmp_path / "one.npy"), light, rtol=0.03)
    again = calibrate_files([tmp_path / "one.npy"], tmp_path / "two.npy", light=[4.0])
    assert again["radiometry"] == "float values taken as linear; divided by the light's 4"
    quarter = read_picture(tmp_path / "one.npy") / 4
    np.testing.assert_allclose(read_picture(tmp_path / "two.npy"), quarter, rtol=1e-6)


def test_a_photograph_says_what_was_done_to_it(tmp_path: Path) -> None:
    mask = np.full((48, 64), 255, np.uint8)
    write_counts(tmp_path / "mask.png", mask)
    write_counts(tmp_path / "p.png", shot(linear_to_srgb)[2])
    encoded = read_photograph(tmp_path / "p.png", tmp_path / "mask.png")
    linear = read_photograph(tmp_path / "p.png", tmp_path / "mask.png", linear=True)
    assert encoded.radiometry == "linearised from sRGB"
    assert linear.radiometry == "8-bit counts taken as linear"
    np.testing.assert_allclose(linear_to_srgb(encoded.image), linear.image, atol=0.5 / 255)
    write_picture(tmp_path / "p.npy", encoded.image)
    floats = read_photograph(tmp_path / "p.npy", tmp_path / "mask.png")
    assert floats.radiometry == "float values taken as linear"
    np.testing.assert_array_equal(floats.image, encoded.image)


@pytest.mark.parametrize(
    ("times", "error"),
    [
        ([1.0, 2.0], ShapeError),
        ([1.0, 0.5, 0.0, 0.1, 0.2], OutOfRangeError),
        ([1.0, 0.5, float("nan"), 0.1, 0.2], OutOfRangeError),
        ([1.0] * 5, OutOfRangeError),
    ],
)
def test_bad_times_are_named(times: list[float], error: type[RadiometryError]) -> None:
    with pytest.raises(error, match="times"):
        merge_exposures(shot(linear_to_srgb), times, debevec_response)


def test_faults_are_named_before_any_work(tmp_path: Path) -> None:
    stack = shot(linear_to_srgb)
    paths = write_stack(tmp_path / "stack", stack, TIMES)
    out = tmp_path / "scene.npy"
    with pytest.raises(FileFormatError, match="use"):
        calibrate_files(paths, tmp_path / "scene.png")
    with pytest.raises(InputFileError, match="does not exist"):
        calibrate_files(paths, tmp_path / "none" / "scene.npy")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputFileError, match="no photographs"):
        calibrate_files([tmp_path / "empty"], out)
    with pytest.raises(InputFileError, match="no photographs"):
        calibrate_files([], out)
    for light in ([0.0], [1.0, 2.0], [1.0, 1.0, -1.0]):
        with pytest.raises(OutOfRangeError, match="light"):
            calibrate_files(paths, out, light=light)
    with pytest.raises(ShapeError, match="one size and type"):
        merge_exposures([stack[0], stack[1][:10]], [1.0, 2.0], srgb_response)
    deep = [counts.astype(np.uint16) for counts in stack]
    with pytest.raises(OutOfRangeError, match="8-bit"):
        merge_exposures(deep, TIMES, debevec_response)
    assert not out.exists()


def test_apertures_that_differ_are_refused(tmp_path: Path) -> None:
    one, two = shot(linear_to_srgb)[:2]
    first = write_stack(tmp_path / "a", [one], [0.5], aperture=8.0)
    second = write_stack(tmp_path / "b", [two], [0.25], aperture=4.0)
    with pytest.raises(InputFileError, match="another aperture"):
        recorded_exposures([*first, *second])
    (tmp_path / "c.png").write_bytes(b"nonsense")
    with pytest.raises(FileFormatError, match="no picture"):
        recorded_exposures([tmp_path / "c.png"])
    write_picture(tmp_path / "d.npy", scene())
    with pytest.raises(InputFileError, match="no exposure time"):
        recorded_exposures([tmp_path / "d.npy"])


def test_jpeg_files_of_a_camera_are_read(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x829A] = 0.004
    Image.fromarray(shot(linear_to_srgb)[0]).save(tmp_path / "a.jpg", exif=exif, quality=95)
    assert recorded_exposures([tmp_path / "a.jpg"]) == pytest.approx([0.004])


@pytest.mark.parametrize("recorded", ["soon", (1, 2), b"x", 0, -1.0])
def test_a_time_that_is_none_is_named(tmp_path: Path, recorded: object) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x829A] = recorded
    Image.fromarray(shot(linear_to_srgb)[0]).save(tmp_path / "a.jpg", exif=exif)
    with pytest.raises(InputFileError, match="no exposure time"):
        recorded_exposures([tmp_path / "a.jpg"])
