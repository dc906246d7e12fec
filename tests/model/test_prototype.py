"""Box prototypes: plain data there and back, every problem named, and the boxes that ship with ecat."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ecat.errors import SchemaError
from ecat.model.prototype import (
    FACES,
    NOMINAL_BOXES,
    SHELL,
    UPRIGHT,
    BoxPrototype,
    FaceName,
    face_normal,
    nominal_face,
)


def problems(data: object) -> set[str]:
    """The fields that are wrong."""
    with pytest.raises(SchemaError) as caught:
        BoxPrototype.from_dict(data)
    return {problem.partition(":")[0] for problem in caught.value.problems}


@pytest.mark.parametrize("box", NOMINAL_BOXES, ids=lambda box: box.name)
def test_a_box_survives_json(box: BoxPrototype) -> None:
    measured = replace(box, faces=(replace(box.faces[0], sigma_m=0.001), *box.faces[1:]))
    assert BoxPrototype.from_dict(json.loads(json.dumps(measured.to_dict()))) == measured


@pytest.mark.parametrize("face", FACES)
def test_an_upright_marker_looks_out_of_its_face(face: FaceName) -> None:
    out = Rotation.from_quat(UPRIGHT[face]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(out, face_normal(face), atol=1e-12)


@pytest.mark.parametrize("face", [face for face in FACES if face[1] != "z"])
def test_an_upright_marker_on_a_side_has_its_top_up(face: FaceName) -> None:
    top = Rotation.from_quat(UPRIGHT[face]).apply([0.0, 1.0, 0.0])
    np.testing.assert_allclose(top, [0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("face", FACES)
def test_a_nominal_marker_sits_in_the_middle_of_its_face(face: FaceName) -> None:
    size = (0.1, 0.2, 0.4)
    centre = np.array(nominal_face(face, "1", 0.05, size).centre)
    axis = "xyz".index(face[1])
    expected = np.zeros(3)
    expected[axis] = size[axis] / 2 * (1 if face[0] == "+" else -1)
    np.testing.assert_allclose(centre, expected)


def test_no_code_occurs_on_two_faces_of_the_shipped_boxes_in_any_rotation() -> None:
    seen: set[bytes] = set()
    for box in NOMINAL_BOXES:
        for face in box.faces:
            cells = np.array([int(cell) for cell in face.code]).reshape(5, 5)
            turned = {np.rot90(cells, k).tobytes() for k in range(4)}
            assert not turned & seen
            seen |= turned


def test_every_problem_is_named_with_its_path() -> None:
    data = SHELL.to_dict()
    data["name"] = ""
    data["size_m"] = [0.1, -0.1, 0.1]
    data["faces"][0] |= {"code": "012", "side_m": 0.0}
    data["faces"][1] |= {"quaternion": [1.0, 1.0, 0.0, 0.0], "sigma_m": -1}
    del data["faces"][2]["centre"]
    assert problems(data) == {
        "name",
        "size_m",
        "faces[0].code",
        "faces[0].side_m",
        "faces[1].quaternion",
        "faces[1].sigma_m",
        "faces[2].centre",
    }


def test_a_face_or_a_code_occurs_once() -> None:
    data = SHELL.to_dict()
    data["faces"].append(dict(data["faces"][0]))
    with pytest.raises(SchemaError) as caught:
        BoxPrototype.from_dict(data)
    assert set(caught.value.problems) == {
        "faces: the same face occurs twice",
        "faces: the same code occurs twice",
    }


@pytest.mark.parametrize("length", [0, -0.1, 10.1, 1e308])
def test_lengths_that_no_box_has_are_refused(length: float) -> None:
    data = SHELL.to_dict()
    data["size_m"][1] = data["faces"][0]["side_m"] = length
    data["faces"][1]["centre"][2] = 10.1
    assert problems(data) == {"size_m", "faces[0].side_m", "faces[1].centre"}


def test_a_box_has_at_most_six_faces() -> None:
    data = SHELL.to_dict()
    data["faces"] *= 10_000
    assert problems(data) == {"faces"}


WRONG: list[object] = [None, True, "x", [], {}, -1, math.nan, math.inf, 10**400, [1, 2], [None] * 3, "∞"]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: repr(wrong)[:12])
@pytest.mark.parametrize("field", ["face", "code", "side_m", "centre", "quaternion"])
def test_a_wrong_value_of_any_type_is_one_problem_of_its_field(field: str, wrong: object) -> None:
    data = SHELL.to_dict()
    data["faces"][0][field] = wrong
    assert problems(data) == {f"faces[0].{field}"}


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(["name", "size_m", "faces", "face", "code", "side_m", "centre"]), inner
            )
        ),
        max_leaves=8,
    )
)
def test_nothing_that_json_can_say_leads_to_anything_but_a_box_or_a_schema_error(data: Any) -> None:
    # anything but a SchemaError passes through, and fails
    with suppress(SchemaError):
        box = BoxPrototype.from_dict(data)
        assert BoxPrototype.from_dict(box.to_dict()) == box
