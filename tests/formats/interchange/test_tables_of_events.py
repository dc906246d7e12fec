"""EPIC-KITCHENS' CSV and plain CSV: rows as people and programs write them."""

from __future__ import annotations

import csv
from pathlib import Path

import pandas as pd
import pytest

from ecat.errors import FormatError, LimitError
from ecat.formats import Format
from ecat.formats.interchange import epic, plain_csv
from ecat.model import AnnotatedObject, Event, Layer, Property, Role, Segment
from ecat.progress import silent
from ecat.sample import sample_session
from ecat.store import create_session
from tests.formats.interchange.documents import CSV, EPIC
from tests.formats.interchange.layers import base_session, there_and_back


def read(form: Format, tmp_path: Path, text: str | bytes) -> Layer:
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    assert form.read_layer is not None
    return form.read_layer(path, base_session(tmp_path, "uniform"))[0]


def test_actions_of_epic_kitchens(tmp_path: Path) -> None:
    layer = read(epic.FORMAT, tmp_path, EPIC)
    door, put = layer.events
    names = {thing.id: thing.name for thing in layer.objects}
    assert (door.type, door.text) == ("open", "open door")
    assert (door.segments[0].start_frame, door.segments[0].start_ns) == (4, 140_000_000)
    assert [(role.name, names[role.target]) for role in put.roles] == [("noun", "cup"), ("noun", "tea spoon")]
    assert put.text == "put cup, spoon"
    assert door.properties == (Property(name="participant_id", value="P01"),)


def test_pandas_reads_the_actions(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    session = create_session(tmp_path / "s", draft)
    assert epic.FORMAT.part is not None
    epic.FORMAT.part(session, "s", tmp_path / "a.csv", epic.EpicOptions(participant="P01"), silent)
    table = pd.read_csv(tmp_path / "a.csv")
    assert tuple(table.columns) == epic.COLUMNS
    assert table["narration_id"].is_unique
    first = table.iloc[0]
    event = draft.layers[0].events[0]
    assert (first["verb"], first["participant_id"]) == (event.type, "P01")
    assert first["start_frame"] == event.segments[0].start_frame + 1
    assert first["stop_frame"] == event.segments[0].end_frame
    nouns = first["all_nouns"].strip("[]").split(", ")
    assert sorted(nouns) == ["'Shell'", "'Stella Artois'"]


def test_a_table_needs_no_more_than_types_and_seconds(tmp_path: Path) -> None:
    first, second = read(plain_csv.FORMAT, tmp_path, CSV).events
    assert (first.id, first.type, second.id) == ("a1", "slide", "a2")
    assert [(s.start_frame, s.start_ns) for s in first.segments] == [(15, 500_000_000)]
    assert first.properties == (Property(name="hand", value="left"),)
    assert second.properties == ()


def test_rows_of_one_event_are_its_stretches(tmp_path: Path) -> None:
    text = "event,start_frame,end_frame,role:Agent\nx,5,9,Ann\nx,20,30,\n"
    (event,) = read(plain_csv.FORMAT, tmp_path, text).events
    assert [(s.start_frame, s.end_frame) for s in event.segments] == [(5, 9), (20, 30)]
    assert [role.name for role in event.roles] == ["Agent"]


def test_python_reads_the_columns_that_are_documented(tmp_path: Path) -> None:
    thing = AnnotatedObject(id="o1", name="Shell")
    event = Event(
        id="a1", type="slide", tier="action", text='say "a, b"\nc', unsure=True,
        segments=(Segment(start_frame=0, end_frame=3), Segment(start_frame=5, end_frame=6)),
        roles=(Role(name="Theme", target="o1"),),
    )  # fmt: skip
    part = Event(id="a2", parent="a1")
    session = base_session(tmp_path, "uniform", Layer(objects=(thing,), events=(event, part)))
    again, findings = there_and_back(plain_csv.FORMAT, session, tmp_path)
    with (tmp_path / "file.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["event"], r["segment"], r["start_frame"], r["end_frame"]) for r in rows] == [
        ("a1", "0", "0", "3"), ("a1", "1", "5", "6"), ("a2", "", "", ""),
    ]  # fmt: skip
    assert (rows[0]["role:Theme"], rows[0]["text"], rows[0]["unsure"]) == ("Shell", event.text, "true")
    assert (rows[1]["role:Theme"], rows[2]["parent"]) == ("", "a1")
    assert [e.id for e in again.events] == ["a1", "a2"]
    assert findings == ()


def test_without_a_clock_a_table_tells_images_only(tmp_path: Path) -> None:
    event = Event(id="a1", segments=(Segment(start_frame=0, end_frame=3),))
    session = base_session(tmp_path, "unknown", Layer(events=(event,)))
    again, _ = there_and_back(plain_csv.FORMAT, session, tmp_path)
    assert again.events[0].segments == event.segments
    assert ",0,3,," in (tmp_path / "file.csv").read_text()


@pytest.mark.parametrize(
    ("form", "text", "told"),
    [
        (plain_csv, "start_s,end_s\n1,x\n", "line 2: expected seconds, found 'x'"),
        (plain_csv, "start_s,end_s\n1,\n", "line 2: a start without an end"),
        (plain_csv, "start_frame,end_frame\n1,99999999999\n", "line 2: expected the number of an image"),
        (plain_csv, "start_s,end_s\n1,2,3\n", "line 2: 3 cells, the first line names 2 columns"),
        (plain_csv, b"start_s,end_s\n1,2\n\xff,3\n", "line 3: not UTF-8"),
        (epic, EPIC.replace("00:00:03.37", "3.37"), "line 2: expected HH:MM:SS.mmm, found '3.37'"),
    ],
)
def test_what_is_no_table_of_events_is_refused(
    form: object, text: str | bytes, told: str, tmp_path: Path
) -> None:
    with pytest.raises(FormatError, match=told):
        read(form.FORMAT, tmp_path, text)  # type: ignore[attr-defined]


def test_a_cell_without_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LimitError, match="field larger than field limit"):
        read(plain_csv.FORMAT, tmp_path, f"start_s,end_s,text\n1,2,{'x' * 200_000}\n")


@pytest.mark.parametrize("form", [plain_csv, epic])
def test_a_text_that_cannot_be_read_again_is_told_when_it_is_written(form: object, tmp_path: Path) -> None:
    event = Event(id="a1", text="x" * 200_000, segments=(Segment(start_frame=0, end_frame=3),))
    session = base_session(tmp_path, "uniform", Layer(events=(event,)))
    options = form.FORMAT.options()  # type: ignore[attr-defined]
    findings = form.FORMAT.part(session, "s", tmp_path / "long.csv", options, silent)  # type: ignore[attr-defined]
    assert "1 text too long for a cell: this table cannot be imported again" in findings
