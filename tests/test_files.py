"""files: exact where the format allows, atomic always, polite about bad data."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from torchradiometry import errors, files
from torchradiometry.places import atomic_path, clear_half_files

RADIANCE = np.random.default_rng(1).uniform(0, 20, (5, 7, 3)).astype(np.float32)


@pytest.mark.parametrize("ending", [".npy", ".exr"])
def test_linear_formats_are_exact(tmp_path: Path, ending: str) -> None:
    path = files.write_picture(tmp_path / f"a{ending}", RADIANCE)
    np.testing.assert_array_equal(files.read_picture(path), RADIANCE)


def test_hdr_keeps_eight_bits_of_the_largest_channel(tmp_path: Path) -> None:
    back = files.read_picture(files.write_picture(tmp_path / "a.hdr", RADIANCE))
    assert (np.abs(back - RADIANCE) <= RADIANCE.max(-1, keepdims=True) / 128).all()


def test_png_is_srgb_encoded_and_clipped(tmp_path: Path) -> None:
    ramp = np.repeat(np.linspace(0, 2, 9, dtype=np.float32)[None, :, None], 3, axis=2)
    back = files.read_picture(files.write_picture(tmp_path / "a.png", ramp, exposure=1.0))
    np.testing.assert_allclose(files.srgb_to_linear(back), ramp.clip(0, 1), atol=0.005)


def test_srgb_curve_is_its_own_inverse_and_hits_known_values() -> None:
    x = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(files.srgb_to_linear(files.linear_to_srgb(x)), x, atol=2e-7)
    np.testing.assert_allclose(files.srgb_to_linear(np.array([0.5])), 0.21404114, rtol=1e-7)


def test_an_error_leaves_neither_the_file_nor_a_temporary(tmp_path: Path) -> None:
    def interrupted() -> None:
        with atomic_path(tmp_path / "a.bin") as temporary:
            temporary.write_bytes(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_an_error_keeps_the_file_that_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    files.write_picture(path, RADIANCE)
    with pytest.raises(errors.InvalidValueError):
        files.write_picture(path, RADIANCE * np.nan)
    np.testing.assert_array_equal(files.read_picture(path), RADIANCE)


@pytest.mark.parametrize(
    ("name", "pixels", "error"),
    [
        ("a.jpg", RADIANCE, errors.FileFormatError),
        ("a.png", RADIANCE[..., 0], errors.ShapeError),
        ("a.exr", np.full_like(RADIANCE, np.inf), errors.InvalidValueError),
        ("none/a.png", RADIANCE, errors.InputFileError),
    ],
)
def test_bad_pictures_are_refused(tmp_path: Path, name: str, pixels, error: type) -> None:
    with pytest.raises(error):
        files.write_picture(tmp_path / name, pixels)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".npy", ".exr", ".hdr", ".png"])
@pytest.mark.parametrize("content", [b"", b"nonsense", None], ids=["empty", "nonsense", "cut"])
def test_damaged_files_are_named(tmp_path: Path, ending: str, content: bytes | None) -> None:
    path = tmp_path / f"a{ending}"
    if content is None:
        whole = files.write_picture(tmp_path / f"b{ending}", RADIANCE).read_bytes()
        content = whole[: len(whole) // 3]
    path.write_bytes(content)
    with pytest.raises(errors.FileFormatError, match=path.name):
        files.read_picture(path)


@pytest.mark.parametrize("ending", [*files.PICTURE_ENDINGS, ".jpg", ".tiff", ".bmp", ".webp"])
@pytest.mark.parametrize("kept", [0.25, 0.5, 0.9, "all but the last byte"])
def test_a_file_that_was_cut_off_is_never_read_as_whole(
    tmp_path: Path, ending: str, kept: float | str
) -> None:
    """Such as a photograph of a full card: half of a JPEG used to be grey, without a word."""
    counts = np.random.default_rng(2).integers(0, 256, (40, 50, 3), np.uint8)
    path = tmp_path / f"a{ending}"
    if ending in files.PICTURE_ENDINGS:
        files.write_picture(path, counts.astype(np.float32))
    else:
        path.write_bytes(files.opencv().imencode(ending, counts)[1].tobytes())
    data = path.read_bytes()
    assert files.read_picture(path).shape == counts.shape
    path.write_bytes(data[:-1] if isinstance(kept, str) else data[: int(kept * len(data))])
    with pytest.raises(errors.FileFormatError, match=path.name):
        files.read_picture(path)


def test_a_file_that_may_not_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files.write_picture(tmp_path / "a.npy", RADIANCE)
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.R_OK)
    with pytest.raises(errors.InputFileError, match="no permission to read it"):
        files.read_picture(tmp_path / "a.npy")


def test_a_pickle_is_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.array([{"a": 1}]), allow_pickle=True)
    with pytest.raises(errors.FileFormatError):
        files.read_picture(path)


def test_missing_and_folder_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(errors.InputFileError, match="no such file"):
        files.read_picture(tmp_path / "a.png")
    with pytest.raises(errors.InputFileError, match="a folder"):
        files.read_picture(tmp_path)


def png_that_claims(width: int, height: int) -> bytes:
    """A PNG header of the given size, and no pixels."""

    def chunk(name: bytes, data: bytes) -> bytes:
        body = name + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = chunk(b"IDAT", zlib.compress(b"\0" * 100))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + pixels + chunk(b"IEND", b"")


def test_a_picture_that_claims_to_be_huge_is_refused_before_decoding(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png_that_claims(60_000, 60_000))
    with pytest.raises(errors.ResourceLimitError, match="pixels"):
        files.read_picture(tmp_path / "a.png")
    wide = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n"
    (tmp_path / "a.hdr").write_bytes(wide)
    with pytest.raises(errors.ResourceLimitError, match="3600000000 pixels"):
        files.read_picture(tmp_path / "a.hdr")
    np.lib.format.open_memmap(tmp_path / "a.npy", "w+", np.uint8, (2**27 + 1,)).flush()
    with pytest.raises(errors.ResourceLimitError, match="pixels"):
        files.read_picture(tmp_path / "a.npy")


def test_what_a_killed_writer_left_is_cleared_and_nothing_else(tmp_path: Path) -> None:
    kept = ["notes.txt", ".hidden", "a.tmp", ".short.tmp"]
    for name in kept:
        (tmp_path / name).touch()
    with atomic_path(tmp_path / "model.onnx") as temporary:
        name = temporary.name
    (tmp_path / name).write_bytes(b"half")  # as if it had been killed inside the block
    clear_half_files(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*kept, "model.onnx"])


@pytest.mark.parametrize("kind", ["U5", "S3", "c8", "V8", "M8[s]", "f4,i4"])
def test_an_array_of_no_real_numbers_is_named(tmp_path: Path, kind: str) -> None:
    np.save(tmp_path / "a.npy", np.zeros((2, 3), np.dtype(kind)))
    with pytest.raises(errors.FileFormatError, match="an array of"):
        files.read_picture(tmp_path / "a.npy")


def test_all_channels_of_an_exr_file_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a picture does not need is decoded too: other channels, other parts."""
    openexr = pytest.importorskip("OpenEXR")
    header = {"type": openexr.scanlineimage}
    grey = np.zeros((8, 8), np.float32)
    small, wide = {"RGB": np.zeros((8, 8, 3), np.float32)}, {f"c{k}": grey for k in range(20)}
    parts = [openexr.Part(dict(header), small, "a"), openexr.Part(dict(header), wide, "b")]
    openexr.File(header, small | wide).write(str(tmp_path / "channels.exr"))
    openexr.File(parts).write(str(tmp_path / "parts.exr"))
    assert files.read_picture(tmp_path / "channels.exr").shape == (8, 8, 3)
    monkeypatch.setattr(files, "MAX_PIXELS", 5 * 64)
    for name in ("channels.exr", "parts.exr"):
        with pytest.raises(errors.ResourceLimitError, match="pixels"):
            files.read_picture(tmp_path / name)
