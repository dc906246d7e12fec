"""CVAT's XML: files as CVAT writes them."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

from ecat.errors import FormatError, LimitError
from ecat.formats.interchange import cvat
from ecat.formats.interchange.cvat import FORMAT, CvatOptions
from ecat.model import AnnotatedObject, Event, Foreign, KeyFrame, Layer, Segment
from ecat.progress import silent
from ecat.store import Session
from tests.formats.interchange.documents import CVAT
from tests.formats.interchange.layers import base_session, there_and_back


@pytest.fixture
def base(tmp_path: Path) -> Session:
    return base_session(tmp_path, "uniform")


def read(base: Session, tmp_path: Path, text: str = CVAT) -> tuple[Layer, tuple[str, ...]]:
    (tmp_path / "a.xml").write_text(text)
    assert FORMAT.read_layer is not None
    return FORMAT.read_layer(tmp_path / "a.xml", base)


def test_tracks_become_objects_with_the_key_frames_that_a_person_set(base: Session, tmp_path: Path) -> None:
    layer, findings = read(base, tmp_path)
    cube, hand, tip = layer.objects
    assert (cube.semantic_type, cube.kind, cube.stream) == ("cube", "rectangle", "color")
    assert [(key.frame, key.present) for key in cube.key_frames] == [(3, True), (5, True), (9, False)]
    assert cube.key_frames[0].coordinates == (10.0, 20.5, 20.25, 19.5)
    assert hand.key_frames[0].coordinates == (1.0, 2.0, 3.0, 4.0, 5.5, 1.0)
    assert [(key.frame, key.present) for key in tip.key_frames] == [(7, True), (8, False)]
    assert findings == ("1 ellipse left out: sessions have no such shape",)


def test_attributes_that_stay_are_properties_and_those_that_change_are_kept(
    base: Session, tmp_path: Path
) -> None:
    cube = read(base, tmp_path)[0].objects[0]
    assert [(p.name, p.value) for p in cube.properties] == [("color", "red")]
    assert cube.key_frames[0].foreign == (Foreign("cvat:attribute:held", "no"),)
    assert cube.key_frames[1].foreign == (
        Foreign("cvat:occluded", "1"), Foreign("cvat:z_order", "2"), Foreign("cvat:attribute:held", "yes"),
    )  # fmt: skip


def test_what_cvat_alone_knows_is_written_again(base: Session, tmp_path: Path) -> None:
    layer = read(base, tmp_path)[0]
    session = base_session(tmp_path / "other", "uniform", layer)
    again, findings = there_and_back(FORMAT, session, tmp_path)
    assert again.objects == layer.objects
    assert findings == ()


def test_tags_on_images_that_follow_one_another_are_an_event(base: Session, tmp_path: Path) -> None:
    (event,) = read(base, tmp_path)[0].events
    assert (event.type, [(s.start_frame, s.end_frame) for s in event.segments]) == ("slide", [(7, 9)])
    assert [(p.name, p.value) for p in event.properties] == [("speed", "fast")]


def test_the_document_is_of_the_form_that_cvat_reads(tmp_path: Path) -> None:
    thing = AnnotatedObject(
        id="o1", name="Shell", kind="rectangle",
        key_frames=(
            KeyFrame(frame=-1, coordinates=(1, 2, 3, 4)), KeyFrame(frame=5, coordinates=(2, 2, 3, 4)),
            KeyFrame(frame=9, present=False),
        ),
    )  # fmt: skip
    event = Event(id="a1", type="slide", text="x", segments=(Segment(start_frame=3, end_frame=5),))
    session = base_session(tmp_path, "uniform", Layer(objects=(thing,), events=(event,)))
    assert FORMAT.part is not None
    FORMAT.part(session, "s", tmp_path / "a.xml", FORMAT.options(), silent)
    root = etree.parse(str(tmp_path / "a.xml")).getroot()
    assert root.findtext("meta/task/size") == "90"
    assert root.findtext("meta/task/original_size/width") == "640"
    (track,) = root.findall("track")
    assert track.get("label") == "Shell"
    boxes = [(b.get("frame"), b.get("outside"), b.get("xtl"), b.get("xbr")) for b in track]
    assert boxes == [("0", "0", "1", "4"), ("5", "0", "2", "5"), ("9", "1", "2", "5")]
    declared = {a.findtext("name") for a in root.iterfind("meta/task/labels/label/attributes/attribute")}
    said = {a.get("name") for a in root.iter("attribute") if a.get("name")}
    assert said <= declared
    images = [(i.get("id"), [t.get("label") for t in i.iterfind("tag")]) for i in root.iterfind("image")]
    assert images == [("3", ["slide"]), ("4", ["slide"])]


def test_events_may_be_left_out(tmp_path: Path) -> None:
    event = Event(id="a1", type="slide", segments=(Segment(start_frame=3, end_frame=5),))
    session = base_session(tmp_path, "uniform", Layer(events=(event,)))
    layer, findings = there_and_back(FORMAT, session, tmp_path, events="none")
    assert layer.events == ()
    assert findings == ("CVAT has no place for 1 event",)


def test_more_tags_than_anybody_wants_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cvat, "MOST_TAGS", 10)
    event = Event(id="a1", segments=(Segment(start_frame=3, end_frame=50),))
    session = base_session(tmp_path, "uniform", Layer(events=(event,)))
    with pytest.raises(LimitError, match="47 images"):
        cvat.part(session, "s", tmp_path / "a.xml", CvatOptions(), silent)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<a><track/></a>", "expected <annotations>"),
        (CVAT.replace('xtl="10.00"', 'xtl="1e999"'), "expected a coordinate, found '1e999'"),
        (CVAT.replace('frame="3"', 'frame="-3"'), "expected an image, found '-3'"),
        (CVAT.replace('points="5.00,6.00"', 'points="5.00"'), "expected points as u,v;u,v"),
        (CVAT.replace('label="cube"', ""), "attribute label is missing"),
    ],
)
def test_what_is_no_annotation_of_cvat_is_refused(
    base: Session, tmp_path: Path, text: str, told: str
) -> None:
    with pytest.raises(FormatError, match=told):
        read(base, tmp_path, text)
