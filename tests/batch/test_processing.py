"""Several sessions: in order, side by side, and whatever happens to one of them."""

from __future__ import annotations

import os
from pathlib import Path
from shutil import copytree

import pytest

from ecat.batch import Outcome, Shard, process_sessions, processing
from ecat.errors import EcatError, UsageError
from ecat.model import Manifest
from ecat.process import ProcessReport, calibrate
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


def shares(paths: list[Path], n: int = 2) -> list[list[Outcome]]:
    return [process_sessions(paths, shard=Shard(i + 1, n), jobs=1) for i in range(n)]


@pytest.mark.slow
@pytest.mark.usefixtures("ray_cluster")
def test_shares_and_every_engine_make_the_same_bytes(paths: list[Path], tmp_path: Path) -> None:
    twins = [copytree(path, tmp_path / "twins" / path.name) for path in paths]
    rays = [copytree(path, tmp_path / "rays" / path.name) for path in paths]
    first, second = shares(paths)
    assert [*summary(first), *summary(second)] == [EXPECTED[i] for i in (0, 2, 1, 3)]
    assert summary(process_sessions(twins, jobs=1)) == EXPECTED
    for path, twin in zip(paths[1:], twins[1:], strict=True):
        assert tables(path) == tables(twin)
    assert summary(process_sessions(rays, jobs=2, engine="ray")) == EXPECTED
    for path, ray in zip(paths[1:], rays[1:], strict=True):
        assert tables(path) == tables(ray)


def test_shares_find_marks_first_and_measure_boxes_when_all_were_found(
    films: tuple[list[Path], list[int]],
) -> None:
    paths, looked_at = films
    [first], [second] = shares(paths)
    assert summary([first, second]) == [("a", ("track",)), ("b", ("track", *RAN))]
    assert first.report is not None
    assert "1 of other shares are still without marks" in first.report.findings[-1]
    [first], [second] = shares(paths)
    assert summary([first, second]) == [("a", RAN), ("b", ())]
    one, other = (open_session(path).manifest.prototypes for path in paths)
    assert one == other == tuple(box.to_dict() for box in calibrate(paths))
    assert len(looked_at) == 2


def test_nobody_waits_for_a_video_that_is_damaged(films: tuple[list[Path], list[int]]) -> None:
    paths, _ = films
    open_session(paths[1]).stream_path("color").write_bytes(b"no video")
    first = process_sessions(paths, shard=Shard(1, 2))
    assert summary(first) == [("a", ("track", *RAN))]


def test_a_share_may_be_empty(paths: list[Path]) -> None:
    assert process_sessions(paths[1:2], shard=Shard(2, 2)) == []


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


def die(task: processing._Task) -> Outcome:  # pyright: ignore[reportPrivateUsage]
    """What a process does that needs more memory than there is."""
    if task.path.name == "b":
        os._exit(9)
    return Outcome(path=task.path, report=ProcessReport(path=task.path, ran=(), skipped=()))


@pytest.mark.slow
def test_a_process_that_dies_is_an_error_of_its_session_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processing, "_outcome", die)
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

    monkeypatch.setattr(processing, "process_session", fake)
    found = process_sessions(paths, jobs=1, prototypes=())
    assert [o.path.name for o in found if o.error] == ["a"]
    error = found[1].error
    assert isinstance(error, EcatError)
    assert error.what == "this is a bug in ecat: ZeroDivisionError"
    assert "test_processing.py, line" in error.where


def test_a_fault_in_the_only_session_is_shown_whole(
    paths: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path, **_: object) -> ProcessReport:
        raise ZeroDivisionError(path)

    monkeypatch.setattr(processing, "process_session", fail)
    with pytest.raises(ZeroDivisionError):
        process_sessions(paths[:1])


def test_an_unknown_stage_is_said_before_anything_is_done(paths: list[Path]) -> None:
    with pytest.raises(UsageError):
        process_sessions(paths, stages=["flatten"])
