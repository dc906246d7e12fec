"""A session at a time: whoever makes the parts, in whatever order, what comes out is the same."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ecat import formats
from ecat.errors import ExistsError, FormatError, NotFoundError
from ecat.formats import Format, Part, exporting, registry
from ecat.formats.options import option
from ecat.progress import Progress, silent
from ecat.store import Session, open_session
from tests.store.sessions import make


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    word: str = option("hello", "what is written")


class Counted:
    """Writes a line about every session, and counts how often; sessions named ``bad`` fail."""

    def __init__(self) -> None:
        self.made: list[str] = []

    def part(
        self, session: Session, label: str, dest: Path, options: Any, progress: Progress
    ) -> tuple[str, ...]:
        self.made.append(label)
        dest.write_text(f"{options.word} {label} {session.manifest.revision}\n")
        if label.endswith("bad"):
            raise FormatError(f"cannot write {label}", where="it is bad")
        return (f"{label} lost its colours",)

    def merge(self, parts: Sequence[Part], dest: Path, options: Any, progress: Progress) -> tuple[str, ...]:
        dest.write_text("".join(part.path.read_text() for part in parts))
        return (f"{len(parts)} parts",)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counted:
    counted = Counted()
    lines = Format(name="lines", description="", part=counted.part, suffix=".txt", options=Options)
    joined = Format(name="joined", description="", part=counted.part, merge=counted.merge, options=Options)
    known = {"lines": lines, "joined": joined}
    monkeypatch.setattr(registry, "find", lambda name: known[name])
    return counted


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    for name in ("b/two", "a/one", "c/three"):
        make(folder / name)
    (folder / "project.json").write_text(
        json.dumps({"schema_version": 1, "name": "p", "created": "2026-01-01T00:00:00Z"})
    )
    return folder


def test_a_session_becomes_the_destination_itself(project: Path, tmp_path: Path, counted: Counted) -> None:
    report = formats.export(project / "a" / "one", tmp_path / "out.txt", format="lines")
    assert (tmp_path / "out.txt").read_text() == "hello one 1\n"
    assert (report.sessions, report.findings) == (1, ("one lost its colours",))


def test_a_project_becomes_a_file_for_each_session(project: Path, tmp_path: Path, counted: Counted) -> None:
    report = formats.export(project, tmp_path / "out", format="lines", options={"word": "hi"})
    files = {p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*.txt")}
    assert files == {"a/one.txt", "b/two.txt", "c/three.txt"}
    assert (tmp_path / "out" / "a" / "one.txt").read_text() == "hi a/one 1\n"
    assert report.findings[0] == "a/one: a/one lost its colours"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "project"]


def test_parts_are_joined_in_the_order_of_their_paths(
    project: Path, tmp_path: Path, counted: Counted
) -> None:
    """Whoever was first."""
    dest, chosen = tmp_path / "out", registry.find("joined")
    tasks = exporting.tasks_of(project, dest, chosen, Options())
    for task in reversed(tasks):
        exporting.make_part(task)
    assert counted.made == ["c/three", "b/two", "a/one"]
    exporting.write(project, dest, chosen, Options())
    assert dest.read_text() == "hello a/one 1\nhello b/two 1\nhello c/three 1\n"
    # what was there already was not made again, and is not needed any more
    assert len(counted.made) == 3
    assert not (tmp_path / ".out.parts").exists()


def test_parts_are_joined_while_others_are_being_made(
    project: Path, tmp_path: Path, counted: Counted, monkeypatch: pytest.MonkeyPatch
) -> None:
    made_when_joined: list[int] = []

    def merge(parts: Sequence[Part], dest: Path, options: Any, progress: Progress) -> tuple[str, ...]:
        for part in parts:
            made_when_joined.append(len(counted.made))
            assert part.path.exists()
        # what was waited for is there a second time
        assert [part.label for part in parts] == ["a/one", "b/two", "c/three"]
        assert parts[-1] == parts[1:][1]
        return counted.merge(parts, dest, options, progress)

    eager = Format(name="joined", description="", part=counted.part, merge=merge, options=Options)
    monkeypatch.setattr(registry, "find", lambda name: eager)
    exporting.write(project, tmp_path / "out", eager, Options())
    assert made_when_joined == [1, 2, 3]


@pytest.mark.parametrize("failure", [KeyboardInterrupt, FormatError("cannot join")])
def test_a_join_that_is_interrupted_leaves_its_parts_and_no_result(
    project: Path, tmp_path: Path, counted: Counted, failure: BaseException | type[BaseException]
) -> None:
    def merge(parts: Sequence[Part], dest: Path, options: Any, progress: Progress) -> tuple[str, ...]:
        dest.write_text(next(iter(parts)).path.read_text())
        raise failure

    ending = Format(name="joined", description="", part=counted.part, merge=merge, options=Options)
    with pytest.raises((KeyboardInterrupt, FormatError)):
        exporting.write(project, tmp_path / "out", ending, Options())
    assert sorted(path.name for path in tmp_path.iterdir()) == [".out.parts", "project"]
    assert not list((tmp_path / ".out.parts").glob("*.partial"))
    exporting.write(project, tmp_path / "out", registry.find("joined"), Options())
    # the one that was made before was taken as it is
    assert counted.made == ["a/one", "b/two", "c/three"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "project"]


@pytest.mark.parametrize("change", ["options", "session", "version", "half", "lost", "about"])
def test_a_part_that_does_not_match_is_made_again(
    project: Path, tmp_path: Path, counted: Counted, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    dest, chosen = tmp_path / "out", registry.find("joined")
    [first, *_] = exporting.tasks_of(project, dest, chosen, Options())
    exporting.make_part(first)
    options = Options()
    if change == "options":
        options = Options(word="good day")
    elif change == "session":
        with open_session(project / "a" / "one").write() as commit:
            commit.put_layer(open_session(project / "a" / "one").layer())
    elif change == "version":
        newer = Format(name="joined", description="", part=counted.part, version="2", options=Options)
        monkeypatch.setattr(registry, "find", lambda name: newer)
    elif change in {"half", "lost"}:
        # as after a power failure: names are there, contents perhaps not
        data = next(path for path in (tmp_path / ".out.parts").iterdir() if path.suffix != ".json")
        data.unlink() if change == "lost" else data.write_bytes(bytes(data.stat().st_size))
    else:
        next((tmp_path / ".out.parts").glob("*.json")).write_text("[]")
    [again, *_] = exporting.tasks_of(project, dest, chosen, options)
    assert exporting.make_part(again).findings == ("a/one lost its colours",)
    assert counted.made == ["a/one", "a/one"]


def test_what_stops_one_session_does_not_stop_the_others(
    project: Path, tmp_path: Path, counted: Counted
) -> None:
    make(project / "b" / "bad")
    report = formats.export(project, tmp_path / "out", format="joined")
    assert (tmp_path / "out").read_text() == "hello a/one 1\nhello b/two 1\nhello c/three 1\n"
    [(path, error)] = report.failures
    assert (path, error.what) == (project / "b" / "bad", "cannot write b/bad")
    assert report.sessions == 3


def test_with_nothing_to_write_nothing_is_written(project: Path, tmp_path: Path, counted: Counted) -> None:
    make(tmp_path / "alone" / "bad")
    with pytest.raises(FormatError, match="cannot write bad"):
        formats.export(tmp_path / "alone" / "bad", tmp_path / "out", format="joined")
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "project.json").write_text((project / "project.json").read_text())
    with pytest.raises(NotFoundError, match="cannot export"):
        formats.export(tmp_path / "empty", tmp_path / "out", format="joined")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["alone", "empty", "project"]


def test_a_destination_that_is_taken_is_refused_before_anything_is_made(
    project: Path, tmp_path: Path, counted: Counted
) -> None:
    (tmp_path / "out").write_text("precious")
    with pytest.raises(ExistsError):
        formats.export(project, tmp_path / "out", format="joined")
    assert (tmp_path / "out").read_text() == "precious"
    assert counted.made == []


def test_an_exception_while_joining_keeps_the_parts(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: Counted
) -> None:
    def fail(parts: Sequence[Part], dest: Path, options: Any, progress: Progress) -> tuple[str, ...]:
        dest.mkdir()
        (dest / "half").write_text("")
        raise KeyboardInterrupt

    dest = tmp_path / "out"
    chosen = Format(name="joined", description="", part=counted.part, merge=fail, options=Options)
    with pytest.raises(KeyboardInterrupt):
        exporting.write(project, dest, chosen, Options())
    assert not dest.exists()
    exporting.write(project, dest, registry.find("joined"), Options(), silent)
    assert len(counted.made) == 3
