"""Reading photographs: units, and every fault by name."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from torchradiometry.deploy.photographs import (
    find_photograph_sets,
    read_photograph,
    read_photographs,
)
from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    InvalidValueError,
    OutOfRangeError,
    RadiometryError,
    ResourceLimitError,
    ShapeError,
)
from torchradiometry.files import srgb_to_linear, write_counts

LIGHTS = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, 0.6, 0.8], [-0.6, 0, 0.8]])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four 6 x 8 photographs whose counts are 10 times their number, two bits of mask."""
    for k in range(4):
        write_counts(tmp_path / f"{k + 1:03d}.png", np.full((6, 8, 3), 10 * (k + 1), np.uint8))
    mask = np.zeros((6, 8), np.uint8)
    mask[2:4, 3:5] = 255
    write_counts(tmp_path / "mask.png", mask)
    np.savetxt(tmp_path / "light_directions.txt", LIGHTS)
    np.savetxt(tmp_path / "light_intensities.txt", np.full((4, 3), 2.0))
    return tmp_path


def test_counts_become_linear_radiance_per_light(folder: Path) -> None:
    photographs = read_photographs(folder)
    assert photographs.images.shape == (4, 6, 8, 3)
    assert photographs.mask.sum() == 4
    expected = (np.array([10, 20, 30, 40]) + 0.5) / 256 / 2
    np.testing.assert_allclose(photographs.images[:, 0, 0, 0], expected, rtol=1e-6)
    np.testing.assert_allclose(photographs.grey()[0], expected * 0.9999, rtol=1e-5)
    assert photographs.ground_truth is None
    some = photographs.under([2, 0])
    np.testing.assert_array_equal(some.light_directions, photographs.light_directions[[2, 0]])


def test_sixteen_bits_and_one_intensity_column(folder: Path) -> None:
    for k in range(4):
        write_counts(folder / f"{k + 1:03d}.png", np.full((6, 8), 6553, np.uint16))
    np.savetxt(folder / "light_intensities.txt", np.full((4, 1), 0.5))
    images = read_photographs(folder).images
    np.testing.assert_allclose(images, 6553 / 65535 / 0.5, rtol=1e-6)


def test_photographs_are_in_the_order_of_their_numbers(folder: Path) -> None:
    (folder / "002.png").rename(folder / "10.png")
    np.testing.assert_allclose(
        read_photographs(folder).images[:, 0, 0, 0] * 512 - 0.5, [10, 30, 40, 20], rtol=1e-5
    )


def test_ground_truth_from_either_file(folder: Path) -> None:
    truth = np.random.default_rng(0).normal(size=(6, 8, 3))
    np.save(folder / "normal_gt.npy", truth)
    np.testing.assert_allclose(read_photographs(folder).ground_truth, truth, rtol=1e-6)
    from scipy.io import savemat

    savemat(folder / "Normal_gt.mat", {"Normal_gt": 2 * truth})
    np.testing.assert_allclose(read_photographs(folder).ground_truth, 2 * truth, rtol=1e-6)


def test_one_photograph_is_linearised(folder: Path) -> None:
    photograph = read_photograph(folder / "004.png", folder / "mask.png")
    np.testing.assert_allclose(photograph.image, srgb_to_linear(np.float64(40 / 255)), rtol=1e-6)


def test_sets_are_found_below_a_folder(folder: Path) -> None:
    assert find_photograph_sets(folder) == [folder]
    for name in ("b", "a"):
        (folder / "sets" / name).mkdir(parents=True)
        (folder / "sets" / name / "light_directions.txt").touch()
    assert [p.name for p in find_photograph_sets(folder / "sets")] == ["a", "b"]
    empty = folder / "empty"
    empty.mkdir()
    with pytest.raises(InputFileError, match="no photographs"):
        find_photograph_sets(empty)
    with pytest.raises(InputFileError, match="no such folder"):
        find_photograph_sets(folder / "absent")


def table(name: str, rows: np.ndarray):
    return lambda folder: np.savetxt(folder / name, rows)


def remove(name: str):
    return lambda folder: (folder / name).unlink()


def write(name: str, data: bytes):
    return lambda folder: (folder / name).write_bytes(data)


def picture(name: str, counts: np.ndarray):
    return lambda folder: write_counts(folder / name, counts)


ROW = "light_directions.txt"
FAULTS = [
    (remove("mask.png"), InputFileError, "no mask"),
    (picture("mask.png", np.zeros((6, 8), np.uint8)), ShapeError, "empty mask"),
    (picture("mask.png", np.full((6, 9), 255, np.uint8)), ShapeError, "8 x 6 pixels"),
    (remove(ROW), InputFileError, "no such file"),
    (remove("light_intensities.txt"), InputFileError, "no such file"),
    (table(ROW, LIGHTS[:3]), ShapeError, "3 lights for 4 photographs"),
    (table("light_intensities.txt", np.ones((5, 3))), ShapeError, "5 lights for 4"),
    (remove("003.png"), ShapeError, "4 lights for 3 photographs"),
    (table(ROW, LIGHTS[:, :2]), FileFormatError, "shape"),
    (table(ROW, LIGHTS * 2), OutOfRangeError, "length 2 in row 1"),
    (table(ROW, LIGHTS * [1, 1, np.nan]), InvalidValueError, "NaN"),
    (write(ROW, b"up\ndown\n"), FileFormatError, "no table"),
    (write(ROW, b"\xff\xfe\x00"), FileFormatError, "no table"),
    (table("light_intensities.txt", np.zeros((4, 3))), OutOfRangeError, "<= 0"),
    (write("002.png", b"not a picture"), FileFormatError, "decoded"),
    (picture("002.png", np.zeros((6, 9), np.uint8)), ShapeError, "9 x 6 pixels"),
    (
        lambda folder: np.save(folder / "normal_gt.npy", np.zeros((6, 9, 3))),
        ShapeError,
        "true normals",
    ),
    (write("Normal_gt.mat", b"nothing"), FileFormatError, "Normal_gt"),
]


@pytest.mark.parametrize(("fault", "error", "words"), FAULTS)
def test_each_fault_has_its_error(folder: Path, fault, error: type, words: str) -> None:
    fault(folder)
    with pytest.raises(error, match=words) as caught:
        read_photographs(folder)
    assert isinstance(caught.value, RadiometryError)


def test_a_folder_without_photographs_or_no_folder(folder: Path) -> None:
    for k in range(4):
        (folder / f"{k + 1:03d}.png").unlink()
    with pytest.raises(InputFileError, match="no photographs"):
        read_photographs(folder)
    with pytest.raises(InputFileError, match="no such folder"):
        read_photographs(folder / "absent")
    with pytest.raises(InputFileError, match="a file"):
        read_photographs(folder / "mask.png")


def test_a_set_too_large_is_refused_before_it_is_decoded(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torchradiometry.deploy.photographs.MAX_SET_BYTES", 1000)
    with pytest.raises(ResourceLimitError, match="2304 bytes"):
        read_photographs(folder)


def test_one_photograph_needs_a_mask_of_its_size(folder: Path) -> None:
    with pytest.raises(InputFileError, match="no mask"):
        read_photograph(folder / "001.png", folder / "absent.png")
    write_counts(folder / "other.png", np.full((5, 8), 255, np.uint8))
    with pytest.raises(ShapeError, match="8 x 6 pixels"):
        read_photograph(folder / "001.png", folder / "other.png")


def test_a_compressed_matrix_that_unpacks_without_end_is_refused(folder: Path) -> None:
    """4 MB of file that would be 4.5 GB in memory."""
    from scipy.io import savemat

    savemat(folder / "Normal_gt.mat", {"Normal_gt": np.zeros((6, 8, 3))}, do_compression=True)
    assert read_photographs(folder).ground_truth is not None
    packer = zlib.compressobj()
    first, again = (packer.compress(bytes(2**27)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in "12")
    data = first + 33 * again
    header = (folder / "Normal_gt.mat").read_bytes()[:128]
    bomb = header + struct.pack("<II", 15, len(data)) + data
    (folder / "Normal_gt.mat").write_bytes(bomb)
    with pytest.raises(ResourceLimitError, match="unpacked"):
        read_photographs(folder)


def test_a_matrix_file_of_very_many_variables_is_refused(folder: Path) -> None:
    from scipy.io import savemat

    savemat(folder / "Normal_gt.mat", {"Normal_gt": np.zeros((6, 8, 3))})
    header = (folder / "Normal_gt.mat").read_bytes()[:128]
    (folder / "Normal_gt.mat").write_bytes(header + struct.pack("<II", 14, 0) * 5000)
    with pytest.raises(ResourceLimitError, match="variables"):
        read_photographs(folder)
