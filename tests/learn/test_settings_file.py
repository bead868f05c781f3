"""Training descriptions as TOML: strict to read, equal after a round trip."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from torchradiometry.errors import FileFormatError, InputFileError, OutOfRangeError
from torchradiometry.learn.samples.data import SurfaceOptions
from torchradiometry.learn.training.settings import PhotometricTraining, ShadingTraining, Training
from torchradiometry.learn.training.settings_file import (
    read_training,
    training_from_table,
    training_table,
    write_training,
)

COUNTS = st.integers(min_value=1, max_value=10**6)
TRAININGS = st.one_of(
    st.builds(
        PhotometricTraining,
        steps=COUNTS,
        rate=st.floats(min_value=0, max_value=1),
        seed=st.integers(min_value=-(2**40), max_value=2**40),
        surfaces=st.builds(SurfaceOptions, shapes=COUNTS, shadows=st.booleans()),
        bfloat16=st.booleans(),
    ),
    st.builds(ShadingTraining, steps=COUNTS, shadows=st.booleans()),
)


@given(training=TRAININGS)
def test_what_is_written_reads_back_equal(
    tmp_path_factory: pytest.TempPathFactory, training: Training
) -> None:
    path = write_training(tmp_path_factory.mktemp("settings") / "training.toml", training)
    assert read_training(path) == training
    assert training_from_table(training_table(training), "here") == training


def test_a_key_that_is_left_out_has_its_default(tmp_path: Path) -> None:
    path = tmp_path / "short.toml"
    path.write_text('kind = "photometric"\nrate = 1\n[surfaces]\nshapes = 3\n')
    found = read_training(path)
    assert found == PhotometricTraining(rate=1.0, surfaces=SurfaceOptions(shapes=3))
    assert type(found.rate) is float


def test_every_field_is_written(tmp_path: Path) -> None:
    text = write_training(tmp_path / "t.toml", PhotometricTraining()).read_text()
    names = [f.name for kind in (PhotometricTraining, SurfaceOptions) for f in fields(kind)]
    assert all(f"{name} = " in text or f"[{name}]" in text for name in names)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steps = 3", "no kind"),
        ('kind = "radiosity"', 'write kind = "photometric" or "shading"'),
        ('kind = "shading"\nstep = 3', "unknown key step; write steps"),
        ('kind = "shading"\nzzz = 3', "unknown key zzz; use steps"),
        ('kind = "photometric"\n[surfaces]\nshape = 3', "unknown key surfaces.shape; write surf"),
        ('kind = "shading"\nsteps = 3.0', "steps = 3.0; write a whole number"),
        ('kind = "shading"\nsteps = true', "steps = True; write a whole number"),
        ('kind = "shading"\nshadows = 1', "shadows = 1; write true or false"),
        ('kind = "shading"\nrate = "fast"', "rate = 'fast'; write a number"),
        ('kind = "photometric"\nsurfaces = 3', "surfaces = 3; write a table"),
        ("kind = ", "no TOML"),
        ("\xff", "no TOML"),
    ],
)
def test_faults_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(FileFormatError) as caught:
        read_training(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_values_outside_their_range_and_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        read_training(tmp_path / "absent.toml")
    (tmp_path / "t.toml").write_text('kind = "shading"\nsteps = 0\n')
    with pytest.raises(OutOfRangeError, match="steps"):
        read_training(tmp_path / "t.toml")
