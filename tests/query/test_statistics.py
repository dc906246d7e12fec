"""What is in a project, counted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from ecat.errors import CorruptError, ExistsError, MissingExtraError, UsageError
from ecat.model import AnnotatedObject, Clock, Event, Layer, Manifest, Relation, Segment
from ecat.model.annotation import Argument
from ecat.query import Statistics, plot_statistics, statistics
from ecat.query.statistics import ASKED, QUESTIONS
from ecat.store import Draft, TableData, create_session
from ecat.tables import TABLES
from tests.store.sessions import rows

pytest.importorskip("duckdb", reason="DuckDB is not installed: pip install 'ecat[query]'")


def event(name: str, start: int, end: int, **more: Any) -> Event:
    return Event(id=name, segments=(Segment(start_frame=start, end_frame=end),), **more)


def layer(name: str, *events: Event) -> Layer:
    return Layer(
        name=name,
        objects=(AnnotatedObject(id="object_id0", name="red", kind="marker_box"),),
        events=events,
        relations=(Relation(id="r1", predicate="ON", start_frame=0, arguments=(Argument(target="o1"),)),),
    )


def session(path: Path, *layers: Layer, places: int = 0) -> None:
    manifest = Manifest(
        name=path.name,
        created="2026",
        n_frames=301,
        clock=Clock(rule="uniform", duration_ns=10_000_000_000),
    )
    tables: dict[str, TableData] = {}
    if places:
        poses = rows("poses", 4)
        source = pa.array(["observed", "observed", "interpolated", None], poses.schema.field("source").type)
        poses = poses.set_column(poses.schema.get_field_index("source"), poses.schema.field("source"), source)
        tables["poses"] = TableData(data=poses)
    create_session(path, Draft(manifest=manifest, layers=layers, tables=tables))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Statistics:
    """Two annotators of a, one of b."""
    folder = tmp_path_factory.mktemp("project")
    slide, slide_2 = (event(f"e{i}", 30 * i, 30 * i + 60, type="slide", tier="t") for i in (1, 2))
    session(
        folder / "a",
        layer(
            "ann",
            slide,
            slide_2,
            event("e3", 30, 45, type="grasp", parent="e1"),
        ),
        layer("ben", slide, event("e2", 61, 120, type="push", tier="t", unsure=True)),
        places=4,
    )
    session(folder / "b", layer("ann", event("e1", 0, 30, type="slide", tier="t")))
    (folder / "c").mkdir()
    (folder / "c" / "session.json").write_text("{")
    return statistics(folder)


def part(found: Statistics, name: str, **where: object) -> dict[str, Any]:
    [row] = [row for row in found.parts[name] if where.items() <= row.items()]
    return row


def test_sessions_and_their_time_are_counted(found: Statistics) -> None:
    assert found.parts["sessions"] == [
        {"sessions": 2, "frames": 602, "duration_s": 20.0, "without_clock": 0, "not_annotated": 0}
    ]
    assert [path.name for path, _ in found.failures] == ["c"]


def test_events_are_counted_by_annotator_level_and_type(found: Statistics) -> None:
    slides = part(found, "events", layer="ann", type="slide")
    assert slides["events"] == 3
    assert slides["sessions"] == 2
    assert slides["level"] == "action"
    assert (slides["shortest_s"], slides["median_s"], slides["longest_s"]) == (1.0, 2.0, 2.0)
    assert slides["total_s"] == 5.0
    assert part(found, "events", type="grasp")["level"] == "part"
    assert part(found, "events", type="push")["unsure"] == 1


def test_frames_of_events_that_overlap_are_counted_once(found: Statistics) -> None:
    assert part(found, "annotated", layer="ann")["frames"] == 90 + 30
    assert part(found, "annotated", layer="ann")["share"] == round(120 / 602, 4)
    assert part(found, "annotated", layer="ben")["frames"] == 90


def test_frames_beyond_the_recording_are_none_of_it(tmp_path: Path) -> None:
    """How long events are is said as they were annotated."""
    session(tmp_path / "a", layer("ann", event("e1", 201, 1201), event("e2", 401, 501)))
    found = statistics(tmp_path)
    assert part(found, "annotated") == {
        "layer": "ann",
        "sessions": 1,
        "frames": 100,
        "share": round(100 / 301, 4),
    }
    assert part(found, "events")["total_s"] == round(1100 * 10 / 300, 3)


def test_where_it_is_not_known_how_many_frames_were_recorded_there_is_no_share_of_them(
    tmp_path: Path,
) -> None:
    session(tmp_path / "a", layer("ann", event("e1", 0, 100)))
    create_session(
        tmp_path / "b",
        Draft(manifest=Manifest(name="b", created="2026"), layers=(layer("ann", event("e1", 0, 500)),)),
    )
    row = part(statistics(tmp_path), "annotated")
    assert (row["frames"], row["share"]) == (600, round(100 / 301, 4))


@pytest.mark.parametrize("how", ["cut", "flipped", "gone"])
def test_a_session_with_a_damaged_table_is_left_out_and_named(tmp_path: Path, how: str) -> None:
    session(tmp_path / "a", layer("ann", event("e1", 0, 30, type="slide")), places=4)
    session(tmp_path / "b", layer("ann", event("e1", 0, 60, type="slide")), places=4)
    whole = statistics(tmp_path / "a").parts
    table = tmp_path / "b" / "tables" / "poses.parquet"
    data = table.read_bytes()
    table.unlink()
    if how != "gone":
        table.write_bytes(
            data[:-40] if how == "cut" else data[:4] + bytes(~b & 255 for b in data[4:900]) + data[900:]
        )
    found = statistics(tmp_path)
    assert found.parts == whole
    [(path, error)] = found.failures
    assert path == tmp_path / "b"
    assert error.what == "cannot read table poses of session b"
    assert f"ecat check {tmp_path / 'b'}" in error.fix
    with pytest.raises(CorruptError, match="cannot read table poses"):
        statistics(tmp_path / "b")


def test_every_table_that_they_read_is_looked_at_for_damage() -> None:
    asked = " ".join(QUESTIONS.values())
    assert set(ASKED) == {name for name in TABLES if re.search(rf"(from|join) {name}\b", asked)}


def test_places_that_are_not_known_count_as_such(found: Statistics) -> None:
    place = part(found, "places", object="red")
    assert (place["frames"], place["observed"], place["interpolated"], place["not_known"]) == (
        4,
        0.5,
        0.25,
        0.25,
    )


def test_objects_and_relations_are_counted(found: Statistics) -> None:
    assert part(found, "objects", layer="ann") == {
        "layer": "ann",
        "kind": "marker_box",
        "objects": 2,
        "sessions": 2,
    }
    assert part(found, "relations", layer="ben")["relations"] == 1


def test_annotators_of_the_same_session_are_compared(found: Statistics) -> None:
    [row] = [row for row in found.agreement if row["tier"] == "t"]
    assert row["annotators"] == "ann, ben"
    assert row["sessions"] == 1
    assert 0 < row["cohen_kappa"] < 1


def test_one_annotator_has_nobody_to_agree_with(tmp_path: Path) -> None:
    session(tmp_path / "a", layer("ann"))
    assert statistics(tmp_path / "a").agreement == []


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_they_are_drawn_and_drawn_again(found: Statistics, tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("matplotlib", reason="Matplotlib is not installed: pip install 'ecat[plots]'")
    for _ in range(2):
        plot_statistics(found, tmp_path / f"s{suffix}", "title")
    assert (tmp_path / f"s{suffix}").stat().st_size > 5_000
    (tmp_path / f"other{suffix}").write_text("precious")
    with pytest.raises(ExistsError):
        plot_statistics(found, tmp_path / f"other{suffix}", "title")


def test_the_picture_shows_what_was_counted(found: Statistics, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    pytest.importorskip("matplotlib", reason="Matplotlib is not installed: pip install 'ecat[plots]'")
    plot_statistics(found, tmp_path / "s.png", "title")
    image = cv2.imread(str(tmp_path / "s.png")).reshape(-1, 3)
    for color in ((0xB6, 0x6F, 0x3B), (0xE6, 0xC0, 0x9D), (0xD9, 0xD9, 0xD9)):
        assert np.count_nonzero((image == color).all(axis=1)) > 500


def test_names_of_any_kind_are_drawn(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    """Matplotlib takes what is between dollar signs for a formula, and a long name for the width of the picture."""
    pytest.importorskip("matplotlib", reason="Matplotlib is not installed: pip install 'ecat[plots]'")
    names = (r"costs $\frac$", "a\nb", "long " * 500, "long " * 501, " ")
    events = (event(f"e{i}", i, i + 9, type=name, tier="t") for i, name in enumerate(names))
    session(tmp_path / "project" / "a", layer("ann", *events))
    plot_statistics(statistics(tmp_path / "project"), tmp_path / "s.png", r"$\frac$")
    assert (tmp_path / "s.png").stat().st_size > 5_000
    assert [str(warning.message) for warning in recwarn] == []


def test_other_kinds_of_pictures_and_a_missing_library_are_told(
    found: Statistics, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(UsageError, match=r"cannot draw s.docx"):
        plot_statistics(found, tmp_path / "s.docx", "title")
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError) as caught:
        plot_statistics(found, tmp_path / "s.png", "title")
    assert "ecat[plots]" in caught.value.fix
