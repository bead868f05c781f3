"""Tensors on two devices are refused by name, before anything is computed.

`meta` is the second device of a machine that has only one.
"""

import pytest
import torch

from tests.hard_cases.subjects import Subject
from tests.hard_cases.survey import MEMBERS
from torchradiometry.errors import DTypeError

#: layers of depth, which bring the intrinsics to the device of the depth map
MOVED = {"input.intrinsics"}
#: layers of one input have no other device beside it
CHECKED = [
    (name, key)
    for name, case in MEMBERS.items()
    if name.startswith(("layer-", "solver-", "adjoint-"))
    for subject in [Subject(name.split("-")[0], case)]
    for keys in [[k for k in subject.easy if k.startswith("input.") and k not in MOVED]]
    for key in keys
    if len(keys) > 1
]


@pytest.mark.parametrize(("name", "key"), CHECKED)
def test_an_input_on_another_device_is_refused(name: str, key: str) -> None:
    subject = Subject(name.split("-")[0], MEMBERS[name])
    moved = subject.easy | {key: subject.easy[key].to("meta")}
    with pytest.raises(DTypeError, match="on meta"):
        subject.call(torch.float64, moved)
