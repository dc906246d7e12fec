"""Sessions joined to one data set: alike in every episode, whatever each of them had."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from ecat.errors import CorruptError
from ecat.formats import Part, exporting, registry
from ecat.formats.lerobot import dataset, layout, video
from ecat.formats.lerobot.merge import merge
from ecat.formats.lerobot.options import LeRobotOptions
from ecat.progress import silent
from tests.formats.lerobot.conftest import Export
from tests.formats.lerobot.recordings import Action, Recording, grey, make

COLOR, DEPTH = "observation.images.color", "observation.images.depth"
TWO = (Action(start=0, end=12), Action(start=15, end=30, text="Slide it"))


def test_episodes_are_numbered_through_and_found_again(export: Export) -> None:
    found = export(Recording(name="a", actions=TWO), Recording(name="b", actions=TWO[1:]))
    assert found.column("index").tolist() == list(range(42))
    assert found.column("episode_index").tolist() == [0] * 12 + [1] * 15 + [2] * 15
    assert [(e["session"], e["dataset_from_index"], e["dataset_to_index"]) for e in found.episodes] == [
        ("a", 0, 12),
        ("a", 12, 27),
        ("b", 27, 42),
    ]
    assert [episode["stats/index/max"] for episode in found.episodes] == [[11], [26], [41]]
    tasks = pq.read_table(found.root / "meta/tasks.parquet").to_pandas()
    assert [tasks.iloc[i].name for i in found.column("task_index")] == ["Slide red past blue"] * 12 + [
        "Slide it"
    ] * 30
    assert (found.info["total_episodes"], found.info["total_frames"], found.info["total_tasks"]) == (3, 42, 2)
    assert found.info["splits"] == {"train": "0:3"}


def test_videos_are_one_after_the_other_as_they_are(export: Export) -> None:
    found = export(Recording(name="a", actions=TWO), Recording(name="b", actions=TWO[1:]))
    assert found.how["video"][COLOR] == {"episodes_copied": 3, "episodes_encoded": 0, "why": {}}
    shown = [image[-1, -1, 0] for image in found.images(COLOR)]
    assert shown == pytest.approx([grey(f) for f in [*range(12), *range(15, 30), *range(15, 30)]], abs=5)
    assert [e[f"videos/{COLOR}/from_timestamp"] for e in found.episodes] == pytest.approx([0, 0.4, 0.9])


def test_a_file_begins_where_the_encoding_changes_or_the_limit_is_reached(
    export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Copied, copied, encoded, copied; each file may hold one second."""
    monkeypatch.setattr(video, "LONGEST_S", 1)
    actions = (*TWO, Action(start=31, end=41), Action(start=45, end=60))
    found = export(Recording(actions=actions))
    files = [e[f"videos/{COLOR}/file_index"] for e in found.episodes]
    assert files == [0, 0, 1, 2]
    assert len(found.images(COLOR, "chunk-000/file-001.mp4")) == 10
    assert len(found.images(COLOR, "chunk-000/file-002.mp4")) == 15


def test_files_and_folders_are_as_large_as_info_says(export: Export, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "MB", 1)
    monkeypatch.setattr(layout, "CHUNK_SIZE", 2)
    monkeypatch.setattr(dataset, "CHUNK_SIZE", 2)
    found = export(Recording(name="a", actions=TWO), Recording(name="b", actions=TWO[1:]))
    at = f"videos/{COLOR}"
    assert [(e["data/chunk_index"], e["data/file_index"]) for e in found.episodes] == [(0, 0), (0, 1), (1, 0)]
    assert [(e[f"{at}/chunk_index"], e[f"{at}/file_index"]) for e in found.episodes] == [
        (0, 0),
        (0, 1),
        (1, 0),
    ]
    assert len(found.rows) == 42


def test_numbers_that_some_sessions_have_not_are_zero_there_and_marked(export: Export) -> None:
    found = export(Recording(name="a", boxes=("red",)), Recording(name="b", boxes=("red", "blue")))
    names = found.info["features"]["observation.state"]["names"]
    assert [name for name in names if name.endswith(".x")] == ["red.x", "blue.x"]
    blue = names.index("blue.x")
    assert found.column("state_known")[:, blue].tolist() == [0.0] * 30 + [1.0] * 30
    assert found.column("observation.state")[:, blue] == pytest.approx([0.0] * 30 + [0.5] * 30)
    assert any(
        line.startswith("a: 7 numbers of observation.state are zero and marked unknown: blue.x, blue.y")
        for line in found.findings
    )
    # statistics are of what is in the rows
    assert found.stats["observation.state"]["mean"][blue] == pytest.approx(0.25)


def test_cameras_are_those_of_most_sessions(export: Export) -> None:
    plain = [Recording(name=name, actions=TWO[:1]) for name in "abc"]
    small = Recording(name="d", size=(32, 24), actions=TWO[:1])
    more = Recording(name="e", views=("color", "depth"), actions=TWO[:1])
    found = export(*plain, small, more)
    assert [e["session"] for e in found.episodes] == ["a", "b", "c", "e"]
    assert [key for key in found.info["features"] if "images" in key] == [COLOR]
    assert f"d: left out; it has not the same {COLOR} as most sessions" in found.findings
    assert f"e: {DEPTH} left out, which most sessions have not" in found.findings


@pytest.mark.parametrize("kind", ["performer", "session"])
def test_who_is_in_test_is_not_in_train(export: Export, kind: str) -> None:
    who = {"a": "Ada", "b": "Bob", "c": "Ada", "d": "Eve"}
    recordings = [
        Recording(name=name, performer=p, views=(), actions=TWO[:1], n_frames=30) for name, p in who.items()
    ]
    found = export(*recordings, split=kind, test_share="0.3")
    train, test = (
        [found.episodes[i] for i in range(*map(int, found.info["splits"][name].split(":")))]
        for name in ("train", "test")
    )
    column = kind if kind == "performer" else "session"
    groups = [{episode[column] for episode in part} for part in (train, test)]
    assert not groups[0] & groups[1]
    assert len(groups[1]) == 1
    assert len(train) + len(test) == 4


def test_with_one_performer_there_is_no_test_and_it_is_said(export: Export) -> None:
    found = export(Recording(views=()), split="performer")
    assert found.info["splits"] == {"train": "0:1"}
    assert any(line.startswith("there is no split test") for line in found.findings)


def test_the_order_in_which_parts_were_made_does_not_matter(export: Export, tmp_path: Path) -> None:
    found = export(Recording(name="a", boxes=("red",)), Recording(name="b"), Recording(name="c"))
    chosen, dest = registry.find("lerobot"), tmp_path / "again"
    tasks = exporting.tasks_of(tmp_path / "project", dest, chosen, LeRobotOptions())
    for task in reversed(tasks):
        assert exporting.make_part(task).error is None
    exporting.write(tmp_path / "project", dest, chosen, LeRobotOptions())
    again = {
        path.relative_to(dest).as_posix(): path.read_bytes() for path in dest.rglob("*") if path.is_file()
    }
    assert again == found.files()


def parts_of(tmp_path: Path, *recordings: Recording) -> list[Part]:
    found: list[Part] = []
    for recording in recordings:
        session = make(tmp_path / "sessions", recording)
        dest = tmp_path / "parts" / recording.name
        assert registry.find("lerobot").part is not None
        registry.find("lerobot").part(session, recording.name, dest, LeRobotOptions(), silent)  # type: ignore[misc]
        found.append(Part(label=recording.name, path=dest))
    return found


def test_parts_stay_as_they_are(tmp_path: Path) -> None:
    parts = parts_of(tmp_path, Recording(name="a"), Recording(name="b"))
    before = {path: path.read_bytes() for path in (tmp_path / "parts").rglob("*") if path.is_file()}
    for dest in ("one", "two"):
        merge(parts, tmp_path / dest, LeRobotOptions(), silent)
    assert before == {path: path.read_bytes() for path in (tmp_path / "parts").rglob("*") if path.is_file()}
    assert json.loads(before[parts[0].path / "meta/info.json"])["total_episodes"] == 1
    assert not list(tmp_path.rglob("*scratch*"))


@pytest.mark.parametrize(
    "file",
    [
        "meta/info.json",
        "meta/ecat.json",
        "meta/part/chunk-000/file-000.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        "data/chunk-000/file-000.parquet",
        "videos/observation.images.color/chunk-000/file-000.mp4",
    ],
)
def test_a_damaged_part_is_one_typed_error(tmp_path: Path, file: str) -> None:
    parts = parts_of(tmp_path, Recording(name="a"), Recording(name="b"))
    path = parts[1].path / file
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(CorruptError, match="cannot join b"):
        merge(parts, tmp_path / "out", LeRobotOptions(), silent)


def test_memory_does_not_grow_with_the_parts(tmp_path: Path) -> None:
    """What is held of a part is its names: eight parts take as much as two."""
    import tracemalloc

    peaks: list[int] = []
    parts = parts_of(tmp_path, *(Recording(name=f"s{i}", n_frames=40, actions=TWO[:1]) for i in range(8)))
    merge(parts[:1], tmp_path / "warm", LeRobotOptions(), silent)
    for n in (2, 8):
        tracemalloc.start()
        merge(parts[:n], tmp_path / f"out{n}", LeRobotOptions(), silent)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] * 1.5


def test_every_row_says_which_episode_of_which_session_it_is(export: Export) -> None:
    found = export(Recording(name="a", actions=TWO), Recording(name="b", actions=TWO[1:]))
    starts = [episode["start_ns"] for episode in found.episodes]
    assert starts == [0, 500_000_000, 500_000_000]
    assert [episode["event"] for episode in found.episodes] == ["a0", "a1", "a0"]
    assert np.diff(found.column("episode_index")).tolist().count(1) == 2
