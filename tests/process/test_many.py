"""Several sessions: in order, side by side, and whatever happens to one of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from shutil import copytree

import pytest

from ecat.errors import EcatError, UsageError
from ecat.model import Manifest
from ecat.process import ProcessReport, calibrate, many, process_sessions
from ecat.process.many import Outcome, usual_jobs
from ecat.sample import sample_session
from ecat.store import Draft, create_session, open_session
from tests.process.films import filmed, find


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sessions a and b of the same boxes; c has no markers, d is damaged."""
    folder = tmp_path_factory.mktemp("many")
    for i, name in enumerate("ab"):
        create_session(folder / name, sample_session(seed=i, actions=("next",), name=name)[0])
    create_session(folder / "c", Draft(manifest=Manifest(name="c", created="2026")))
    create_session(folder / "d", sample_session(seed=2, actions=("next",), name="d")[0])
    (folder / "d" / "tables" / "markers_2d.parquet").write_bytes(b"PAR1")
    return folder


@pytest.fixture
def paths(made: Path, tmp_path: Path) -> list[Path]:
    copytree(made, tmp_path / "project")
    return [tmp_path / "project" / name for name in "dabc"]


def tables(path: Path) -> dict[str, str]:
    return {record.name: record.sha256 for record in open_session(path).manifest.tables}


def summary(outcomes: list[Outcome]) -> list[tuple[str, object]]:
    return [(o.path.name, o.report.ran if o.report else type(o.error).__name__) for o in outcomes]


MISSING = {
    "face_planes": "no depth video in this session",
    "outline": "no depth video in this session",
    "hull": "nobody drew a shape in the images",
}
RAN = ("plane", "pose", "relations", "propose")
EXPECTED = [("d", "CorruptError"), ("a", RAN), ("b", RAN), ("c", ())]


@pytest.mark.slow
def test_two_processes_make_the_same_bytes_as_one_in_the_same_order(
    paths: list[Path], tmp_path: Path
) -> None:
    twins = [copytree(path, tmp_path / "twins" / path.name) for path in paths]
    said: list[tuple[str, int, int]] = []
    found = process_sessions(
        paths, jobs=2, name=lambda path: path.name, progress=lambda *now: said.append(now)
    )
    assert summary(found) == EXPECTED
    assert summary(process_sessions(twins, jobs=1)) == EXPECTED
    for path, twin in zip(paths[1:], twins[1:], strict=True):
        assert tables(path) == tables(twin)
    assert sorted(name for name, *_ in said[-4:]) == ["a", "b", "c", "d"]
    assert said[-1][1:] == (4, 4)
    # nothing is left to do
    assert [o.report.ran for o in process_sessions(paths, jobs=1) if o.report] == [(), (), ()]


def test_sessions_left_by_an_interruption_get_the_boxes_that_they_would_have_got(paths: list[Path]) -> None:
    def stop(what: str, done: int, total: int) -> None:
        if what.startswith(str(paths[2])):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process_sessions(paths, jobs=1, progress=stop)
    first, second = (open_session(path).manifest.prototypes for path in paths[1:3])
    assert first
    assert not second
    assert summary(process_sessions(paths, jobs=1))[1:3] == [("a", ()), ("b", RAN)]
    assert open_session(paths[2]).manifest.prototypes == first


@pytest.fixture
def films(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[list[Path], list[int]]:
    """Two sessions whose marks are found in their videos, and the lengths of the videos that were looked at."""
    paths = [tmp_path / "films" / name for name in "ab"]
    found = [filmed(path, seed) for seed, path in enumerate(paths)]
    assert len({truth.n_frames for truth, _ in found}) == 2
    return paths, find(monkeypatch, [marks for _, marks in found])


def test_boxes_seen_in_videos_are_measured_by_all_videos_together(
    films: tuple[list[Path], list[int]],
) -> None:
    paths, looked_at = films
    assert summary(process_sessions(paths, jobs=1)) == [(name, ("track", *RAN)) for name in "ab"]
    first, second = (open_session(path).manifest.prototypes for path in paths)
    assert first == second == tuple(box.to_dict() for box in calibrate(paths))
    assert summary(process_sessions(paths, jobs=1)) == [("a", ()), ("b", ())]
    assert process_sessions(paths[:1])[0].report == ProcessReport(
        path=paths[0], ran=(), skipped=("track", *RAN), not_applicable=MISSING
    )
    assert len(looked_at) == 2


@pytest.mark.parametrize("at", [0, 1])
def test_what_was_interrupted_while_videos_are_searched_is_gone_on_with(
    films: tuple[list[Path], list[int]], at: int
) -> None:
    paths, looked_at = films
    last: list[str] = []

    def stop(what: str, done: int, total: int) -> None:
        # in the search of the first video, or once both were searched
        last.append(what)
        if len(looked_at) > at:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process_sessions(paths, jobs=1, progress=stop)
    assert not any(open_session(path).manifest.prototypes for path in paths)
    assert summary(process_sessions(paths, jobs=1))[1] == ("b", (*(("track",) if at == 0 else ()), *RAN))
    first, second = (open_session(path).manifest.prototypes for path in paths)
    assert first == second == tuple(box.to_dict() for box in calibrate(paths))


def test_to_look_for_marks_only_measures_no_boxes(films: tuple[list[Path], list[int]]) -> None:
    paths, looked_at = films
    assert summary(process_sessions(paths, stages=["track"])) == [("a", ("track",)), ("b", ("track",))]
    assert [open_session(path).manifest.prototypes for path in paths] == [(), ()]
    assert len(looked_at) == 2


@pytest.mark.slow
def test_an_interruption_ends_the_other_processes(paths: list[Path]) -> None:
    import multiprocessing

    def stop(what: str, done: int, total: int) -> None:
        if done == 1 and what in {"a", "b", "c", "d"}:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process_sessions(paths, jobs=2, name=lambda path: path.name, progress=stop)
    assert multiprocessing.active_children() == []
    for path in paths[1:]:
        assert open_session(path).manifest.revision >= 1


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals are those of POSIX")
def test_processes_do_not_outlive_the_one_that_started_them() -> None:
    lines = (
        "import os, time",
        "from ecat.process.many import _pool",
        "with _pool(1) as pool:",
        "    print(pool.submit(os.getpid).result(), flush=True)",
        "    pool.submit(time.sleep, 600).result()",
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", "\n".join(lines)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    with parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        os.kill(child, 0)
        parent.kill()
        # the pipe is closed when the last process that has it has ended
        assert parent.communicate(timeout=60)[0] == b""


def die(task: many._Task) -> Outcome:  # pyright: ignore[reportPrivateUsage]
    """What a process does that needs more memory than there is."""
    if task.path.name == "b":
        os._exit(9)
    return Outcome(path=task.path, report=ProcessReport(path=task.path, ran=(), skipped=()))


@pytest.mark.slow
def test_a_process_that_dies_is_an_error_of_its_session_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(many, "_outcome", die)
    found = process_sessions([Path(name) for name in "abcd"], jobs=2, prototypes=())
    assert [(o.path.name, o.error is None) for o in found] == [
        ("a", True),
        ("b", False),
        ("c", True),
        ("d", True),
    ]
    assert "was killed" in str(found[1].error)


def test_a_fault_in_one_session_does_not_stop_the_others(
    paths: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fake(path: Path, **_: object) -> ProcessReport:
        if path.name == "a":
            raise ZeroDivisionError("division by zero")
        return ProcessReport(path=path, ran=(), skipped=())

    monkeypatch.setattr(many, "process_session", fake)
    found = process_sessions(paths, jobs=1, prototypes=())
    assert [o.path.name for o in found if o.error] == ["a"]
    error = found[1].error
    assert isinstance(error, EcatError)
    assert error.what == "this is a bug in ecat: ZeroDivisionError"
    assert "test_many.py, line" in error.where


def test_a_fault_in_the_only_session_is_shown_whole(
    paths: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path, **_: object) -> ProcessReport:
        raise ZeroDivisionError(path)

    monkeypatch.setattr(many, "process_session", fail)
    with pytest.raises(ZeroDivisionError):
        process_sessions(paths[:1])


def test_an_unknown_stage_is_said_before_anything_is_done(paths: list[Path]) -> None:
    with pytest.raises(UsageError):
        process_sessions(paths, stages=["flatten"])


def test_a_few_sessions_are_not_worth_another_process() -> None:
    assert [usual_jobs(n) for n in (0, 1, 3)] == [1, 1, 1]
    assert 1 <= usual_jobs(4) <= 4
    assert usual_jobs(10**6) == usual_jobs(10**6 + 1)
