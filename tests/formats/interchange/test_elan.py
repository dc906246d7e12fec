"""ELAN: files of ELAN itself, and ours as another program reads them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from ecat.errors import FormatError
from ecat.formats.interchange.elan import FORMAT
from ecat.model import Event, Layer, Link, Role, Segment
from ecat.model.scheme import CodingScheme, EventType, Tier
from ecat.progress import silent
from ecat.sample import sample_session
from ecat.store import Session, create_session, open_session
from ecat.store.schemes import write_scheme
from tests.formats.interchange.documents import EAF
from tests.formats.interchange.layers import base_session, there_and_back


def opened(path: Path) -> Any:
    """The file in pympi."""
    return pytest.importorskip("pympi").Elan.Eaf(str(path))


@pytest.fixture
def base(tmp_path: Path) -> Session:
    return base_session(tmp_path, "uniform")


def read(base: Session, tmp_path: Path, text: str = EAF) -> tuple[dict[str, Event], tuple[str, ...]]:
    (tmp_path / "a.eaf").write_text(text)
    assert FORMAT.read_layer is not None
    layer, findings = FORMAT.read_layer(tmp_path / "a.eaf", base)
    return {event.id: event for event in layer.events}, findings


class TestReadingElan:
    """What ELAN writes is understood."""

    def test_values_of_a_vocabulary_are_types_and_others_texts(self, base: Session, tmp_path: Path) -> None:
        events, _ = read(base, tmp_path)
        assert (events["a1"].type, events["a1"].text, events["a1"].tier) == ("deictic", "", "gesture")
        assert (events["a5"].type, events["a5"].text, events["a5"].tier) == ("", "that", "word")

    def test_times_become_frames_and_are_kept(self, base: Session, tmp_path: Path) -> None:
        events, _ = read(base, tmp_path)
        (segment,) = events["a1"].segments
        assert (segment.start_frame, segment.end_frame) == (30, 89)
        assert segment.end_ns is not None
        assert abs(segment.end_ns - 3_000_000_000) <= 500_000 or segment.end_ns == 3_000_000_000

    def test_slots_without_a_time_share_what_lies_around_them(self, base: Session, tmp_path: Path) -> None:
        events, _ = read(base, tmp_path)
        assert events["a2"].segments[0].end_frame == events["a3"].segments[0].start_frame == 60

    def test_annotations_below_are_parts_of_the_one_that_they_lie_in(
        self, base: Session, tmp_path: Path
    ) -> None:
        events, _ = read(base, tmp_path)
        assert {events[name].parent for name in ("a2", "a3", "a5", "a6")} == {"a1"}
        assert events["a2"].tier == "phase"

    def test_what_is_symbolic_divides_the_time_above_in_its_order(
        self, base: Session, tmp_path: Path
    ) -> None:
        events, findings = read(base, tmp_path)
        assert [events[n].segments[0].start_frame for n in ("a5", "a6")] == [30, 60]
        assert "2 annotations without a time placed evenly in the one above" in findings

    def test_what_is_said_of_an_annotation_is_a_property(self, base: Session, tmp_path: Path) -> None:
        events, _ = read(base, tmp_path)
        assert {(p.name, p.value) for p in events["a1"].properties} == {
            ("hand", "left"),
            ("participant", "P1"),
        }
        assert events["a1"].author == "ann"

    def test_an_origin_of_time_is_added(self, base: Session, tmp_path: Path) -> None:
        shifted = EAF.replace('MIME_TYPE="video/mp4"', 'MIME_TYPE="video/mp4" TIME_ORIGIN="500"')
        events, _ = read(base, tmp_path, shifted)
        assert events["a1"].segments[0].start_frame == 45

    def test_tiers_that_are_below_each_other_are_at_the_top(self, base: Session, tmp_path: Path) -> None:
        round_ = EAF.replace('TIER_ID="gesture"', 'TIER_ID="gesture" PARENT_REF="phase@gesture"')
        events, _ = read(base, tmp_path, round_)
        assert {"a1", "a2", "a3"} <= events.keys()

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            ("<a/>", "expected <ANNOTATION_DOCUMENT>"),
            (EAF.replace('"3000"', '"3 s"'), "expected milliseconds, found '3 s'"),
            (EAF.replace('TIME_SLOT_REF2="ts3"', ""), "attribute TIME_SLOT_REF2 is missing"),
            (EAF[:900], "the file ends too early"),
            ("<!DOCTYPE a [<!ENTITY b 'c'>]>" + EAF.partition("?>")[2], "document type declaration"),
        ],
    )
    def test_what_is_no_document_of_elan_is_refused(
        self, base: Session, tmp_path: Path, text: str, told: str
    ) -> None:
        with pytest.raises(FormatError, match=told):
            read(base, tmp_path, text)


class TestWritingForElan:
    """Another program reads what we write: pympi."""

    @pytest.fixture
    def eaf(self, tmp_path: Path) -> Any:
        draft, _ = sample_session(seed=3)
        session = create_session(tmp_path / "s", draft)
        assert FORMAT.part is not None
        FORMAT.part(session, "s", tmp_path / "a.eaf", FORMAT.options(), silent)
        return opened(tmp_path / "a.eaf")

    def test_it_reads_every_annotation(self, eaf: Any, tmp_path: Path) -> None:
        draft, _ = sample_session(seed=3)
        events = draft.layers[0].events
        found = [(round((s.start_ns or 0) / 1e6), round((s.end_ns or 0) / 1e6), e.type) for e in events
                 for s in e.segments]  # fmt: skip
        lanes = [tier for tier in eaf.tiers if re.fullmatch(r"event|sub-event( #\d+)?@event", tier)]
        read = [annotation for lane in lanes for annotation in eaf.get_annotation_data_for_tier(lane)]
        assert sorted(read) == sorted(found)

    def test_it_knows_the_tiers_and_their_constraints(self, eaf: Any) -> None:
        assert eaf.get_parameters_for_tier("sub-event@event")["PARENT_REF"] == "event"
        kind = eaf.get_parameters_for_linguistic_type("sub-event (Included_In)")
        assert kind["CONSTRAINTS"] == "Included_In"
        assert kind["CONTROLLED_VOCABULARY_REF"] == "sub-event"
        assert set(eaf.constraints) == {
            "Time_Subdivision", "Symbolic_Subdivision", "Symbolic_Association", "Included_In",
        }  # fmt: skip

    def test_it_knows_the_vocabulary_of_the_coding_scheme(self, eaf: Any) -> None:
        entries: Iterable[Any] = eaf.get_cv_entries("sub-event").values()
        assert [values[0][0] for values, _ in entries] == ["grasp", "hold", "move", "release"]

    def test_it_knows_who_takes_part(self, eaf: Any) -> None:
        agents = {value for *_, value, _ in eaf.get_ref_annotation_data_for_tier("Agent@event")}
        assert agents == {"Performer 1"}
        # pympi follows references up to the top, and stumbles over tiers with times below others
        hands = {value for _, value, _, _ in eaf.tiers["Agent@sub-event@event"][1].values()}
        assert hands <= {"Performer 1/HandLeft", "Performer 1/HandRight"}

    def test_it_knows_the_linked_video(self, eaf: Any) -> None:
        (media,) = eaf.get_linked_files()
        assert media["RELATIVE_MEDIA_URL"].startswith("./rgb_")

    def test_what_it_writes_again_is_read_the_same(self, eaf: Any, tmp_path: Path) -> None:
        session = open_session(tmp_path / "s")
        eaf.to_file(str(tmp_path / "again.eaf"))
        assert FORMAT.read_layer is not None
        mine, _ = FORMAT.read_layer(tmp_path / "a.eaf", session)
        again, _ = FORMAT.read_layer(tmp_path / "again.eaf", session)
        assert sorted(again.events, key=lambda e: e.id) == sorted(mine.events, key=lambda e: e.id)


def event(number: int, start: int, end: int, **more: Any) -> Event:
    return Event(id=f"a{number}", segments=(Segment(start_frame=start, end_frame=end),), **more)


def test_parts_that_fill_their_whole_divide_it_and_share_its_time_slots(tmp_path: Path) -> None:
    layer = Layer(
        scheme="phases",
        events=(
            event(1, 10, 40, tier="gesture", type="beat"),
            event(2, 10, 20, tier="phase", type="up", parent="a1"),
            event(3, 20, 40, tier="phase", type="down", parent="a1"),
        ),
    )
    session = base_session(tmp_path, "uniform", layer)
    tiers = (Tier(name="gesture"), Tier(name="phase", parent="gesture", constraint="subdivision"))
    kinds = tuple(EventType(name=name, tier="phase") for name in ("up", "down", "still"))
    scheme = CodingScheme(name="phases", tiers=tiers, event_types=kinds)
    write_scheme(scheme, session.path / "annotations" / "phases.scheme.xml")
    again, _ = there_and_back(FORMAT, session, tmp_path)
    eaf = opened(tmp_path / "file.eaf")
    kind = eaf.get_parameters_for_linguistic_type("phase (Time_Subdivision)")
    assert kind["CONSTRAINTS"] == "Time_Subdivision"
    assert len(eaf.timeslots) == 3
    assert {e.id: (e.parent, e.segments[0].start_frame) for e in again.events} == {
        "a1": (None, 10), "a2": ("a1", 10), "a3": ("a1", 20),
    }  # fmt: skip
    assert again.scheme == "phases"


def test_a_part_outside_of_its_whole_says_whose_part_it_is(tmp_path: Path) -> None:
    layer = Layer(events=(event(1, 10, 20, text="whole"), event(2, 15, 30, text="part", parent="a1")))
    session = base_session(tmp_path, "uniform", layer)
    again, _ = there_and_back(FORMAT, session, tmp_path)
    assert [e.parent for e in again.events] == [None, "a1"]
    assert "parent@(no tier) #2" in opened(tmp_path / "file.eaf").tiers


def test_roles_called_like_a_fact_do_not_take_its_place(tmp_path: Path) -> None:
    roles = (Role(name="text", target="a2", kind="event"), Role(name="status", target="a1", kind="event"))
    links = (Link(type="CAUSE", target="a2"),)
    layer = Layer(
        events=(
            event(1, 0, 5, roles=roles, links=links, tier="text"),
            event(2, 0, 5, parent="a1", tier="text"),
        )
    )
    session = base_session(tmp_path, "uniform", layer)
    again, _ = there_and_back(FORMAT, session, tmp_path)
    assert again.events[0].roles == roles
    assert again.events[0].links == links
