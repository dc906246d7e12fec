"""Box prototypes survive being saved, and wrong ones are refused with every fault named."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from ecat.errors import SchemaError
from ecat.geometry.transforms import matrix_from_quaternion
from ecat.model.prototype import FACES, NOMINAL_BOXES, STELLA_ARTOIS, UPRIGHT, BoxPrototype, face_normal


@pytest.mark.parametrize("box", NOMINAL_BOXES, ids=lambda box: box.name)
def test_prototypes_survive_json(box: BoxPrototype) -> None:
    assert BoxPrototype.from_dict(json.loads(json.dumps(box.to_dict()))) == box


def test_upright_markers_look_outwards_with_their_top_up() -> None:
    for face in FACES:
        turn = matrix_from_quaternion(np.array(UPRIGHT[face]))
        np.testing.assert_allclose(turn[:, 2], face_normal(face), atol=1e-12)
        if face[1] != "z":
            np.testing.assert_allclose(turn[:, 1], [0, 0, 1], atol=1e-12)


def broken(**changes: Any) -> dict[str, Any]:
    data = STELLA_ARTOIS.to_dict()
    for path, value in changes.items():
        target = data["faces"][1] if path in data["faces"][1] else data
        target[path] = value
    return data


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ([], "prototype: expected an object"),
        ({}, "prototype.faces: missing"),
        (broken(name=""), "name: expected a non-empty string"),
        (broken(size_m=[0.1, 0.1]), "size_m: expected 3 finite numbers"),
        (broken(size_m=[0.1, -0.1, 0.1]), "size_m: expected three positive lengths"),
        (broken(faces=[]), "faces: expected a non-empty list"),
        (broken(face="top"), "faces[1].face: expected one of"),
        (broken(face="+z"), "faces: the same face occurs twice"),
        (broken(code="10110"), "faces[1].code: expected a square number"),
        (broken(code=STELLA_ARTOIS.faces[0].code), "faces: the same code occurs twice"),
        (broken(side_m=True), "faces[1].side_m: expected a finite number"),
        (broken(side_m=0), "faces[1].side_m: expected a positive length"),
        (broken(centre=[0, 0, float("nan")]), "faces[1].centre: expected 3 finite numbers"),
        (broken(quaternion=[0, 0, 0, 2]), "faces[1].quaternion: expected a unit quaternion"),
        (broken(sigma_m=-1), "faces[1].sigma_m: expected null or a length"),
    ],
)
def test_wrong_prototypes_are_refused(data: object, problem: str) -> None:
    with pytest.raises(SchemaError) as caught:
        BoxPrototype.from_dict(data)
    assert any(found.startswith(problem) for found in caught.value.problems)


def test_all_faults_are_told_at_once() -> None:
    with pytest.raises(SchemaError) as caught:
        BoxPrototype.from_dict(broken(side_m=0, code="2", name=7))
    assert len(caught.value.problems) == 3
