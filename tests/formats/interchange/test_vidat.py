"""Vidat's JSON as Vidat writes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ecat.formats.interchange.vidat import FORMAT
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Role, Segment
from ecat.model.shapes import shape_at
from ecat.progress import silent
from tests.formats.interchange.documents import VIDAT
from tests.formats.interchange.layers import base_session


@pytest.fixture
def read(tmp_path: Path) -> tuple[Layer, tuple[str, ...]]:
    (tmp_path / "a.json").write_text(json.dumps(VIDAT))
    assert FORMAT.read_layer is not None
    return FORMAT.read_layer(tmp_path / "a.json", base_session(tmp_path, "uniform"))


def test_actions_are_events_in_seconds(read: Any) -> None:
    (event,) = read[0].events
    assert (event.type, event.text) == ("slide", "to the left")
    assert [(s.start_frame, s.end_frame) for s in event.segments] == [(15, 45)]
    assert event.roles == (Role(name="object", target=read[0].objects[0].id),)


def test_images_of_another_rate_are_taken_as_times(read: Any) -> None:
    layer, findings = read
    cube = layer.objects[0]
    # images 0, 10 and 20 at ten a second
    assert [(key.frame, key.present) for key in cube.key_frames] == [(0, True), (30, True), (60, False)]
    assert any("taken as times, at 10 images a second" in line for line in findings)


def test_labels_and_instances_name_the_objects(read: Any) -> None:
    cube, region = read[0].objects
    assert (cube.name, cube.semantic_type, cube.color) == ("cube", "", "#0000ffff")
    assert (region.name, region.semantic_type, region.kind) == ("cube 2", "cube", "polygon")


def test_skeletons_are_told_of(read: Any) -> None:
    assert "1 skeleton left out" in read[1]


def test_every_listed_image_has_all_that_is_to_be_seen_in_it(tmp_path: Path) -> None:
    one = AnnotatedObject(
        id="o1", name="Shell", kind="rectangle",
        key_frames=(
            KeyFrame(frame=0, coordinates=(0, 0, 5, 5)), KeyFrame(frame=10, coordinates=(10, 0, 5, 5)),
            KeyFrame(frame=20, present=False),
        ),
    )  # fmt: skip
    other = AnnotatedObject(
        id="o2", kind="rectangle", key_frames=(KeyFrame(frame=5, coordinates=(1, 1, 2, 2)),)
    )
    event = Event(id="a1", type="slide", segments=(Segment(start_frame=3, end_frame=6),))
    session = base_session(tmp_path, "uniform", Layer(objects=(one, other), events=(event,)))
    assert FORMAT.part is not None
    FORMAT.part(session, "s", tmp_path / "a.json", FORMAT.options(), silent)
    said = json.loads((tmp_path / "a.json").read_text())
    annotation, config = said["annotation"], said["config"]
    assert annotation["keyframeList"] == [0, 5, 10, 20]
    boxes = {int(k): v for k, v in annotation["objectAnnotationListMap"].items()}
    assert {frame: len(shapes) for frame, shapes in boxes.items()} == {0: 1, 5: 2, 10: 2, 20: 1}
    assert (boxes[5][0]["x"], boxes[5][0]["y"]) == shape_at(one, 5)[:2]  # type: ignore[index]
    labels = {label["id"]: label["name"] for label in config["objectLabelData"]}
    assert [labels[box["labelId"]] for box in boxes[5]] == ["Shell", "o2"]
    (action,) = annotation["actionAnnotationList"]
    assert {a["id"]: a["name"] for a in config["actionLabelData"]}[action["action"]] == "slide"
