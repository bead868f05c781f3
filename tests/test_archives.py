"""archives: what a few bytes of a zip file may stand for is bounded, whatever it says of itself."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from torchradiometry import archives, errors


def packed(path: Path, data: bytes, kind: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", kind) as archive:
        archive.writestr("Z.npy", data)
    return path


def test_arrays_come_back_by_name(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", Z=np.arange(6.0), other=np.zeros(2))
    (found,) = archives.read_arrays(tmp_path / "a.npz", "file", ["Z"])
    np.testing.assert_array_equal(found, np.arange(6.0))
    assert list(archives.read_parts(tmp_path / "a.npz", "file")) == ["Z.npy", "other.npy"]
    with pytest.raises(errors.FileFormatError, match="KeyError"):
        archives.read_arrays(tmp_path / "a.npz", "file", ["absent"])


def test_parts_unpack_no_further_than_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = packed(tmp_path / "a.zip", bytes(10**6))
    monkeypatch.setattr(archives, "MAX_BYTES", 10**5)
    with pytest.raises(errors.ResourceLimitError, match="when unpacked"):
        archives.read_parts(path, "file")
    said = path.read_bytes().replace(struct.pack("<I", 10**6), struct.pack("<I", 10))
    path.write_bytes(said)
    with pytest.raises(zipfile.BadZipFile):  # ten bytes, and they are not those of the sum
        archives.read_parts(path, "file")


@pytest.mark.parametrize("kind", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_packing_without_a_bound_is_refused(tmp_path: Path, kind: int) -> None:
    with pytest.raises(ValueError, match="unusual"):
        archives.read_parts(packed(tmp_path / "a.zip", b"1", kind), "file")
    with pytest.raises(errors.FileFormatError):
        archives.read_arrays(tmp_path / "a.zip", "file", ["Z"])


def test_a_list_of_contents_without_end_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = packed(tmp_path / "a.zip", b"1")
    end, wide = path.read_bytes()[-22:], bytearray(56)
    wide[40:48] = (2**40).to_bytes(8, "little")
    data = path.read_bytes()[:-22] + bytes(wide) + b"PK\6\7" + bytes(16) + end
    (tmp_path / "b.zip").write_bytes(data)
    with pytest.raises(errors.ResourceLimitError, match="very many parts"):
        archives.read_parts(tmp_path / "b.zip", "file")
    monkeypatch.setattr(archives, "MAX_CONTENTS", 10)
    with pytest.raises(errors.ResourceLimitError, match="very many parts"):
        archives.read_parts(path, "file")
