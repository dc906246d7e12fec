"""Label Studio's JSON: images from 1, per cent, and shapes that are still there where they are switched off."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

from ecat.formats.interchange.label_studio import FORMAT
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Link, Role, Segment
from ecat.model.shapes import shape_at
from ecat.progress import silent
from ecat.store import Session
from tests.formats.interchange.documents import LABEL_STUDIO
from tests.formats.interchange.layers import base_session, there_and_back


@pytest.fixture
def base(tmp_path: Path) -> Session:
    return base_session(tmp_path, "uniform")


def read(base: Session, tmp_path: Path, tasks: Any = LABEL_STUDIO) -> tuple[Layer, tuple[str, ...]]:
    (tmp_path / "a.json").write_text(json.dumps(tasks))
    assert FORMAT.read_layer is not None
    return FORMAT.read_layer(tmp_path / "a.json", base)


def test_a_shape_is_there_up_to_the_image_where_it_is_switched_off(base: Session, tmp_path: Path) -> None:
    (cube,) = read(base, tmp_path)[0].objects
    there = [frame for frame in range(20) if shape_at(cube, frame) is not None]
    # images 2 to 10, 13, and from 16 on, counted from 1
    assert there == [*range(1, 10), 12, *range(15, 20)]


def test_per_cent_become_pixels(base: Session, tmp_path: Path) -> None:
    (cube,) = read(base, tmp_path)[0].objects
    assert cube.semantic_type == "cube"
    assert shape_at(cube, 1) == (64.0, 240.0, 32.0, 48.0)
    assert shape_at(cube, 5) == (96.0, 240.0, 32.0, 48.0)


def test_ranges_include_their_last_image(base: Session, tmp_path: Path) -> None:
    (event,) = read(base, tmp_path)[0].events
    assert (event.type, event.tier) == ("Moving", "timelineLabels")
    assert [(s.start_frame, s.end_frame) for s in event.segments] == [(2, 5)]


def test_relations_to_objects_are_roles_and_other_results_are_told_of(base: Session, tmp_path: Path) -> None:
    layer, findings = read(base, tmp_path)
    assert layer.events[0].roles == (Role(name="theme", target=layer.objects[0].id),)
    assert findings == ("1 result of other kinds left out",)


def test_a_task_that_counts_other_images_is_taken_by_time(base: Session, tmp_path: Path) -> None:
    text = json.dumps(LABEL_STUDIO).replace('"framesCount": 90', '"framesCount": 72')
    layer, findings = read(base, tmp_path, json.loads(text))
    # at 24 images a second the second one begins a twenty-fourth of a second after the first
    assert layer.objects[0].key_frames[0].frame == 1
    assert layer.events[0].segments[0].end_frame == 6
    assert findings[1] == (
        "the file counts 72 images, the session has 90: its numbers were taken as times, at 24 images a second"
    )


def test_without_the_size_of_the_images_shapes_are_left_out(tmp_path: Path) -> None:
    session = base_session(tmp_path, "uniform", width_px=None, height_px=None)
    layer, findings = read(session, tmp_path)
    assert [len(thing.key_frames) for thing in layer.objects] == [0]
    assert "shapes of 1 object left out: the size of the images is not known" in findings


def sample(tmp_path: Path, **stream: Any) -> Session:
    thing = AnnotatedObject(
        id="o1", name="Shell", kind="rectangle", semantic_type="block",
        key_frames=(
            KeyFrame(frame=0, coordinates=(64, 48, 64, 48)), KeyFrame(frame=4, coordinates=(128, 48, 64, 48)),
            KeyFrame(frame=8, present=False),
        ),
    )  # fmt: skip
    events = (
        Event(id="a1", type="slide", tier="action", text="Slide it", segments=(Segment(start_frame=0, end_frame=9),),
              roles=(Role(name="Theme", target="o1"), Role(name="Agent", target="o1/Hand", kind="joint"))),
        Event(id="a2", type="hold", tier="part", parent="a1", segments=(Segment(start_frame=3, end_frame=4),),
              links=(Link(type="CAUSE", target="a1"),)),
        Event(id="a3", status="proposed", author="model 1", segments=(Segment(start_frame=3, end_frame=4),)),
    )  # fmt: skip
    return base_session(tmp_path, "uniform", Layer(objects=(thing,), events=events), **stream)


def write(session: Session, tmp_path: Path) -> tuple[Any, tuple[str, ...]]:
    assert FORMAT.part is not None
    findings = FORMAT.part(session, "s", tmp_path / "a.json", FORMAT.options(), silent)
    (task,) = json.loads((tmp_path / "a.json").read_text())
    return task, findings


def test_the_task_is_of_the_form_that_label_studio_reads(tmp_path: Path) -> None:
    task, findings = write(sample(tmp_path), tmp_path)
    box, slide, hold, theme, cause = task["annotations"][0]["result"]
    assert [(k["frame"], k["enabled"], k["x"]) for k in box["value"]["sequence"]] == [
        (1, True, 10.0), (5, True, 20.0), (8, False, 20.0),
    ]  # fmt: skip
    assert (box["value"]["framesCount"], box["value"]["labels"]) == (90, ["block"])
    assert slide["value"] == {"ranges": [{"start": 1, "end": 9}], "timelinelabels": ["slide"]}
    assert slide["meta"] == {"text": ["Slide it"]}
    assert hold["parentID"] == "a1"
    assert (theme["from_id"], theme["to_id"], theme["labels"]) == ("a1", "o1", ["role:Theme"])
    assert (cause["from_id"], cause["to_id"], cause["labels"]) == ("a2", "a1", ["CAUSE"])
    assert task["predictions"][0]["model_version"] == "model 1"
    assert findings[-1] == "1 role or link to what is no region there left out"


def test_the_labeling_interface_names_every_control_and_label(tmp_path: Path) -> None:
    task, _ = write(sample(tmp_path), tmp_path)
    view = etree.fromstring(task["data"]["label_config"])
    controls = {element.get("name") for element in view}
    used = {result["from_name"] for result in task["annotations"][0]["result"] if "from_name" in result}
    assert used <= controls
    labels = {label.get("value") for label in view.iter("Label")}
    assert {"block", "slide", "hold", "unlabelled"} <= labels


def test_without_the_size_of_the_images_it_says_how_to_give_it(tmp_path: Path) -> None:
    session = sample(tmp_path, width_px=None, height_px=None)
    _, findings = write(session, tmp_path)
    assert any("--option width=" in line for line in findings)
    layer, findings = there_and_back(FORMAT, session, tmp_path, width=640, height=480)
    assert layer.objects[0].key_frames[0].coordinates == (64, 48, 64, 48)
