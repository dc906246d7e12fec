"""Many sessions at once: the same bytes whoever makes them, and whatever happens on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ecat import formats
from ecat.batch import Engine, Shard, export_sessions
from ecat.errors import ExistsError, UsageError
from ecat.store import remote
from tests.store.sessions import make

FORMAT = "csv"


def tree(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("project")
    for number in range(6):
        make(folder / f"s{number}", number)
    return folder


@pytest.fixture(scope="module")
def expected(project: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    dest = tmp_path_factory.mktemp("one") / "out"
    formats.export(project, dest, format=FORMAT)
    return tree(dest)


@pytest.mark.slow
@pytest.mark.parametrize(("engine", "jobs"), [("processes", 1), ("processes", 2), ("ray", 2)])
def test_every_engine_writes_the_same_bytes(
    project: Path,
    expected: dict[str, bytes],
    tmp_path: Path,
    engine: Engine,
    jobs: int,
    request: pytest.FixtureRequest,
) -> None:
    if engine == "ray":
        request.getfixturevalue("ray_cluster")
    said: list[tuple[str, int, int]] = []
    report = export_sessions(
        project,
        tmp_path / "out",
        format=FORMAT,
        jobs=jobs,
        engine=engine,
        progress=lambda *now: said.append(now),
    )
    assert tree(tmp_path / "out") == expected
    assert report.sessions == 6
    assert (6, 6) in [(done, total) for _, done, total in said]


def test_shares_made_apart_and_in_any_order_are_joined_to_the_same(
    project: Path, expected: dict[str, bytes], tmp_path: Path
) -> None:
    dest = tmp_path / "out"
    for index in (3, 1, 2):
        report = export_sessions(project, dest, format=FORMAT, shard=Shard(index, 3))
        assert report.sessions == 2
        assert not dest.exists()
    times = {path: path.stat().st_mtime_ns for path in Path(report.path).glob("*.json")}
    assert len(times) == 6
    export_sessions(project, dest, format=FORMAT)
    assert tree(dest) == expected
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_share_that_nobody_made_is_made_when_they_are_joined(
    project: Path, expected: dict[str, bytes], tmp_path: Path
) -> None:
    export_sessions(project, tmp_path / "out", format=FORMAT, shard=Shard(1, 3))
    export_sessions(project, tmp_path / "out", format=FORMAT)
    assert tree(tmp_path / "out") == expected


@pytest.mark.slow
def test_after_a_kill_the_same_command_goes_on(
    project: Path, expected: dict[str, bytes], tmp_path: Path
) -> None:
    dest = tmp_path / "out"
    code = "import sys; from ecat.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [
        sys.executable,
        "-c",
        code,
        "export",
        str(project),
        str(dest),
        "--format",
        FORMAT,
        "--jobs",
        "1",
    ]
    running = subprocess.Popen([*command, "-q"])
    parts = tmp_path / ".out.parts"
    # somewhere in between, if the machine is not too fast
    while running.poll() is None and not list(parts.glob("*.json")):
        time.sleep(0.001)
    running.send_signal(signal.SIGKILL)
    running.wait()
    made = {path: path.stat().st_ino for path in parts.glob("*.json")}
    if dest.exists():
        pytest.skip("it was done before it could be killed")
    assert subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode == 0
    assert made
    assert tree(dest) == expected
    assert os.listdir(tmp_path) == ["out"]  # noqa: PTH208


def test_a_damaged_session_is_named_and_the_others_are_written(
    project: Path, expected: dict[str, bytes], tmp_path: Path
) -> None:
    for number in range(6):
        make(tmp_path / "p" / f"s{number}", number)
    (tmp_path / "p" / "s3" / "session.json").write_text("{")
    report = export_sessions(tmp_path / "p", tmp_path / "out", format=FORMAT)
    assert [Path(path).name for path, _ in report.failures] == ["s3"]
    assert tree(tmp_path / "out").keys() == expected.keys() - {"s3.csv"}


def test_a_bug_met_in_one_session_is_told_like_a_fault_of_the_session(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("ecat.formats.exporting.open_session", fail)
    with pytest.raises(Exception, match="this is a bug in ecat: ZeroDivisionError"):
        export_sessions(project, tmp_path / "out", format=FORMAT, jobs=1)


def test_a_destination_that_is_taken_and_a_share_of_a_whole_are_refused(
    project: Path, tmp_path: Path
) -> None:
    (tmp_path / "out").write_text("precious")
    with pytest.raises(ExistsError):
        export_sessions(project, tmp_path / "out", format=FORMAT, shard=Shard(1, 2))
    with pytest.raises(UsageError, match="cannot export a share"):
        export_sessions(project, tmp_path / "new", format="ecat-2018", shard=Shard(1, 2))
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("shards", [0, 2])
def test_sessions_and_destination_may_be_urls(
    project: Path, expected: dict[str, bytes], tmp_path: Path, shards: int
) -> None:
    """Of a store in memory, which one process sees; tests of the store itself use one over HTTP."""
    pytest.importorskip("fsspec", reason="fsspec is not installed: pip install 'ecat[remote]'")
    lab = f"memory://lab/{tmp_path.name}"
    remote.send(project, f"{lab}/project")
    for index in range(1, shards + 1):
        export_sessions(f"{lab}/project", f"{lab}/out", format=FORMAT, jobs=1, shard=Shard(index, shards))
    report = export_sessions(f"{lab}/project", f"{lab}/out", format=FORMAT, jobs=1)
    assert report.path == f"{lab}/out"
    remote.fetch(f"{lab}/out", tmp_path / "back")
    assert tree(tmp_path / "back") == expected
    assert remote.read(f"{lab}/out.parts") is None
    with pytest.raises(ExistsError):
        export_sessions(f"{lab}/project", f"{lab}/out", format=FORMAT, jobs=1)
    with pytest.raises(UsageError, match="from folder to folder"):
        export_sessions(f"{lab}/project", tmp_path / "x", format="ecat-2018")
    remote.remove(lab)


def test_what_one_process_holds_in_its_memory_is_not_for_several(project: Path, tmp_path: Path) -> None:
    pytest.importorskip("fsspec", reason="fsspec is not installed: pip install 'ecat[remote]'")
    lab = f"memory://lab/{tmp_path.name}"
    remote.send(project, f"{lab}/project")
    for path, dest in ((project, f"{lab}/out"), (f"{lab}/project", tmp_path / "out")):
        with pytest.raises(UsageError, match="no other sees it") as caught:
            export_sessions(path, dest, format=FORMAT, jobs=2)
        assert "--jobs 1" in caught.value.fix
    assert list(tmp_path.iterdir()) == []
    assert remote.read(f"{lab}/out") is None
    remote.remove(lab)
