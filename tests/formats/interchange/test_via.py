"""VIA 3 projects as VIA writes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ecat.formats.interchange.via import FORMAT
from ecat.model import Layer
from ecat.progress import silent
from ecat.sample import sample_session
from ecat.store import create_session
from tests.formats.interchange.documents import VIA
from tests.formats.interchange.layers import base_session


@pytest.fixture
def read(tmp_path: Path) -> tuple[Layer, tuple[str, ...]]:
    (tmp_path / "a.json").write_text(json.dumps(VIA))
    assert FORMAT.read_layer is not None
    return FORMAT.read_layer(tmp_path / "a.json", base_session(tmp_path, "uniform"))


def test_a_segments_option_is_its_type_and_the_attribute_its_tier(read: Any) -> None:
    (event,) = read[0].events
    assert (event.tier, event.type) == ("Activity", "Pour")
    assert [(p.name, p.value) for p in event.properties] == [("note", "slowly")]
    assert [(s.start_frame, s.end_frame) for s in event.segments] == [(30, 75)]


def test_regions_of_one_label_are_one_object_unless_at_one_time(read: Any) -> None:
    egg, other = read[0].objects
    assert (egg.name, other.name) == ("Egg", "Egg 2")
    assert [key.frame for key in egg.key_frames] == [27, 57]
    assert other.key_frames[0].coordinates == (1, 2, 3, 4)


def test_circles_are_boxed_and_lines_left_out(read: Any) -> None:
    layer, findings = read
    assert layer.objects[0].key_frames[1].coordinates == (5, 5, 10, 10)
    assert findings[0] == "1 entry neither of a time nor of a known shape left out"


def test_the_project_is_of_the_form_that_via_reads(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=2, actions=("next",))
    session = create_session(tmp_path / "s", draft)
    assert FORMAT.part is not None
    FORMAT.part(session, "s", tmp_path / "a.json", FORMAT.options(), silent)
    project = json.loads((tmp_path / "a.json").read_text())
    assert {"project", "config", "attribute", "file", "view", "metadata"} == project.keys()
    for entry in project["metadata"].values():
        assert entry["vid"] in project["view"]
        anchor = "FILE1_Z2_XY0" if len(entry["z"]) == 2 else "FILE1_Z1_XY1"
        for number, value in entry["av"].items():
            attribute = project["attribute"][number]
            assert attribute["anchor_id"] == anchor
            assert not attribute["options"] or value in attribute["options"]
    tiers = {a["aname"]: a["options"] for a in project["attribute"].values() if a["desc"] == "ecat:tier"}
    assert set(tiers["sub-event"].values()) == {"grasp", "hold", "move", "release"}
