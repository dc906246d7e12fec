"""``kill -9`` at any instant leaves the old state or the new one, and what was acknowledged is there."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from ecat.errors import StaleError
from ecat.store import (
    Journal,
    Session,
    leftovers,
    open_session,
    rebuild_layer,
    remove_leftovers,
    validate,
)
from tests.store.conftest import Writers
from tests.store.sessions import append, make, number_at, number_of

KILLS = int(os.environ.get("ECAT_TEST_KILLS", "60"))
"""How many processes are killed at random instants; more find rarer faults."""


def pid_of(answers: Iterator[str]) -> int:
    """The process that writes, which says so before anything else."""
    word, pid = next(answers).split()
    assert word == "pid", "another process would be killed"
    return int(pid)


def kill_after(writers: Writers, chance: random.Random, *words: object) -> list[int]:
    """Let a process write, kill it soon after, and return the numbers that it had acknowledged."""
    answers = writers.start("loop", *words)
    pid = pid_of(answers)
    lines = [next(answers).split() for _ in range(chance.randrange(3))]
    time.sleep(chance.uniform(0.0, 0.03))
    os.kill(pid, signal.SIGKILL)
    lines += [line.split() for line in answers]
    assert {line[0] for line in lines} <= {"ack"}, lines
    return [int(line[1]) for line in lines]


def test_a_commit_killed_at_a_random_instant_is_whole_or_absent(session: Session, writers: Writers) -> None:
    chance = random.Random(0)
    last = 0
    for _ in range(KILLS // 2):
        acknowledged = kill_after(writers, chance, "commit", session.path)
        last = max(acknowledged, default=last)
        found = number_at(session.path)
        assert last <= found <= last + 1
        last = found
    assert last > 0
    assert all(path.name.endswith(".new") for path in leftovers(session.path))
    remove_leftovers(session.path)
    assert {path.name for path in session.path.iterdir()} - {"session.lock"} == {
        "annotations",
        "session.json",
        "tables",
    }
    assert not list(session.path.rglob(".*"))


def test_a_creation_killed_at_a_random_instant_is_whole_or_absent(tmp_path: Path, writers: Writers) -> None:
    chance = random.Random(1)
    made = 0
    for _ in range(KILLS // 2):
        acknowledged = kill_after(writers, chance, "create", tmp_path)
        found = sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith("."))
        made = max([made, *(number + 1 for number in acknowledged)])
        assert made <= len(found) <= made + 1
        made = len(found)
    assert made > 0
    for number in range(made):
        assert number_at(tmp_path / f"s{number}") == number
    abandoned = leftovers(tmp_path)
    assert remove_leftovers(tmp_path) == abandoned
    assert {path.name for path in tmp_path.iterdir()} == {f"s{number}" for number in range(made)}


@pytest.mark.parametrize("action", ["commit", "create"])
def test_a_death_before_any_step_leaves_the_old_state_or_the_new_one(
    action: str, tmp_path: Path, writers: Writers
) -> None:
    base = tmp_path / "base"
    base.mkdir()
    if action == "commit":
        make(base / "s0")
    outcomes: list[int] = []
    for step in range(1000):
        place = tmp_path / "place"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(base, place)
        target = place / "s0"
        answers = writers.run("once", step, action, target if action == "commit" else place)
        if action == "commit":
            outcomes.append(number_at(target))
        else:
            outcomes.append(number_at(target) + 1 if target.exists() else 0)
        remove_leftovers(target if action == "commit" else place)
        assert not list(place.rglob(".*"))
        if answers == ["done"]:
            break
        assert answers == []
    assert outcomes == sorted(outcomes), "an earlier death got further than a later one"
    assert set(outcomes) == {0, 1}
    assert len(outcomes) > 30


@pytest.mark.parametrize("content", [None, b"<annotation"], ids=["gone", "cut"])
def test_a_death_before_any_step_of_rebuilding_a_layer_leaves_one_that_can_be_rebuilt(
    content: bytes | None, session: Session, tmp_path: Path, writers: Writers
) -> None:
    append(session, 2)
    wanted, whole = open_session(session.path).layer(), (session.path / "annotations/main.xml").read_bytes()
    (session.path / "annotations/main.xml").unlink()
    if content is not None:
        (session.path / "annotations/main.xml").write_bytes(content)
    outcomes: list[bool] = []
    for step in range(100):
        place = tmp_path / "place"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(session.path, place)
        xml, answers = place / "annotations/main.xml", writers.run("once", step, "rebuild", place)
        outcomes.append(xml.exists() and xml.read_bytes() == whole)
        aside = [path.read_bytes() for path in xml.parent.glob("*.old")]
        if content is not None:
            there = [xml.read_bytes()] if xml.exists() else []
            assert content in [*aside, *there], "what was there is lost"
        rebuild_layer(open_session(place), "main")
        assert open_session(place).layer() == wanted
        assert validate(open_session(place), deep=True) == []
        remove_leftovers(place)
        assert not list(place.rglob(".*"))
        if answers == ["done"]:
            break
        assert answers == []
    assert outcomes == sorted(outcomes), "an earlier death got further than a later one"
    assert set(outcomes) == {False, True}


def test_a_killed_journal_keeps_what_was_acknowledged(session: Session, writers: Writers) -> None:
    acknowledged: list[int] = []
    for turn in range(5):
        acknowledged += kill_after(writers, random.Random(turn), "journal", session.path)
        found = [record.revision for record, _ in Journal(session.path, "main").records()]
        assert found == list(range(1, len(found) + 1))
        assert len(acknowledged) <= len(found) <= len(acknowledged) + 1
        acknowledged = found
    assert acknowledged


def test_two_processes_lose_no_update(session: Session, writers: Writers) -> None:
    assert sorted(writers.run("both", 5, session.path)) == ["done 5", "done 5"]
    assert number_at(session.path) == 10


def test_a_reader_beside_a_writer_never_sees_a_mix(session: Session, writers: Writers) -> None:
    answers = writers.start("loop", "commit", session.path)
    pid = pid_of(answers)
    seen: set[int] = set()
    try:
        deadline = time.monotonic() + 1.5
        while time.monotonic() < deadline:
            try:
                seen.add(number_of(open_session(session.path)))
            except StaleError:
                continue
    finally:
        os.kill(pid, signal.SIGKILL)
    assert "ack" in {line.split()[0] for line in answers}
    assert seen, "every read was overtaken by a commit"


def test_a_full_disk_leaves_the_old_state(session: Session, writers: Writers) -> None:
    # the limit on the size of files is the one shortage of space that needs no permission to bring about
    assert writers.run("limit", 900, "commit", session.path) == ["error DiskError"]
    assert number_at(session.path) == 0
    assert leftovers(session.path) == []


def test_a_full_disk_leaves_nothing_of_a_new_session(tmp_path: Path, writers: Writers) -> None:
    for limit in (10, 900, 5000):
        assert writers.run("limit", limit, "create", tmp_path) == ["error DiskError"]
        assert list(tmp_path.iterdir()) == []
