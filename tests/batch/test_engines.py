"""The same results wherever the work is done."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from ecat.batch import engines
from ecat.batch.engines import Engine, Workers, usual_jobs
from ecat.errors import MissingExtraError, UsageError
from tests.store.sessions import make

ENGINES: list[Engine] = ["processes", "ray"]


@dataclass(frozen=True)
class Task:
    """A number to square; the deadly kill their process, always or the first time."""

    number: int
    deadly: str = ""
    marker: Path | None = None


def square(task: Task) -> int:
    first = task.marker is not None and not task.marker.exists()
    if task.marker is not None:
        task.marker.touch()
    if task.deadly == "always" or (task.deadly == "once" and first):
        os.kill(os.getpid(), signal.SIGKILL)
    return task.number**2


def died(task: Task) -> int:
    return -task.number


def results(tasks: list[Task], engine: Engine, jobs: int = 2) -> list[int]:
    kept: list[int] = []
    with Workers(engine, jobs) as workers:
        found = list(workers.run(square, tasks, died=died, keep=kept.append))
        # those who have done it can do more
        assert list(workers.run(square, tasks[:1], died=died, keep=lambda _: None)) == found[:1]
    assert sorted(kept) == sorted(found)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_results_come_in_the_order_of_the_tasks(engine: Engine) -> None:
    """Without Ray running, it is started for the call."""
    if engine == "ray":
        pytest.importorskip("ray", reason="Ray is not installed: pip install 'ecat[ray]'")
    assert results([Task(n) for n in range(30)], engine) == [n**2 for n in range(30)]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_only_the_task_that_kills_its_process_is_given_up(
    engine: Engine, request: pytest.FixtureRequest
) -> None:
    """Ray runs already, as where a program uses it for other things as well."""
    if engine == "ray":
        request.getfixturevalue("ray_cluster")
    tasks = [Task(n, deadly="always" if n == 3 else "") for n in range(8)]
    assert results(tasks, engine) == [0, 1, 4, -3, 16, 25, 36, 49]


@pytest.mark.slow
def test_a_process_that_was_killed_by_chance_is_not_the_end_of_its_task(tmp_path: Path) -> None:
    tasks = [Task(n, deadly="once" if n == 3 else "", marker=tmp_path / str(n)) for n in range(6)]
    assert results(tasks, "processes") == [0, 1, 4, 9, 16, 25]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals are those of POSIX")
def test_processes_do_not_outlive_the_one_that_started_them() -> None:
    lines = (
        "import os, time",
        "from ecat.batch.engines import pool",
        "with pool(1) as processes:",
        "    print(processes.submit(os.getpid).result(), flush=True)",
        "    processes.submit(time.sleep, 600).result()",
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


@pytest.mark.slow
def test_whoever_has_enough_ends_the_processes() -> None:
    with Workers("processes", 2) as workers:
        work = workers.run(square, [Task(n) for n in range(100)], died=died, keep=lambda _: None)
        assert [next(work), next(work)] == [0, 1]
        work.close()
    assert multiprocessing.active_children() == []


WITHOUT_GUARD = """\
import sys
from ecat.batch import export_sessions, process_sessions
from ecat.errors import UsageError
from ecat.store import find_sessions

try:
    {call}
except UsageError as error:
    print(error.what, error.fix, sep="; ")
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "call",
    [
        'export_sessions(sys.argv[1], sys.argv[2], format="csv", jobs=2)',
        "process_sessions(find_sessions(sys.argv[1]), jobs=2)",
    ],
    ids=["export", "process"],
)
def test_a_script_that_its_processes_would_run_again_is_told_how_to_mend_it(
    tmp_path: Path, call: str
) -> None:
    """The processes import the script's file; nothing of it is done by them, nor done again for ever."""
    for number in range(2):
        make(tmp_path / "project" / f"s{number}", number)
    (tmp_path / "script.py").write_text(WITHOUT_GUARD.format(call=call))
    command = [sys.executable, "script.py", "project", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    fix = 'in a script, call ecat below `if __name__ == "__main__":`, or with jobs=1'
    assert (done.stdout, done.stderr) == (f"cannot do several sessions at once; {fix}\n", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["project", "script.py"]


def environment(name: str) -> str | None:
    return os.environ.get(name)


@pytest.mark.slow
def test_processes_have_the_environment_of_now(monkeypatch: pytest.MonkeyPatch) -> None:
    for value in ("first", "then"):
        monkeypatch.setenv("ECAT_TEST_PLACE", value)
        with Workers("processes", 1) as workers:
            work = workers.run(environment, ["ECAT_TEST_PLACE"], died=str, keep=lambda _: None)
            assert list(work) == [value]


def test_nothing_to_do_takes_no_process() -> None:
    assert results([], "processes") == []


def test_without_ray_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(MissingExtraError, match="cannot use --engine ray") as caught:
        Workers("ray", 1)
    assert "ecat[ray]" in caught.value.fix


def test_a_cluster_that_does_not_start_or_answer_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    class Ray:
        def is_initialized(self) -> bool:
            return False

        def init(self, **_: object) -> None:
            raise Exception("The current node timed out during startup.")  # noqa: TRY002  as Ray does

    monkeypatch.setattr(engines, "_installed", lambda _: True)
    monkeypatch.setattr(engines, "_ray", Ray)
    monkeypatch.setenv("RAY_ADDRESS", "10.0.0.1:6379")
    with (
        pytest.raises(UsageError, match=r"10\.0\.0\.1:6379: The current node timed out"),
        Workers("ray", 1) as workers,
    ):
        list(workers.run(square, [Task(1)], died=died, keep=lambda _: None))


def test_few_tasks_are_done_by_one_process() -> None:
    assert [usual_jobs(n) for n in (0, 1, 3)] == [1, 1, 1]
    assert 1 <= usual_jobs(4) <= 4
    assert usual_jobs(10**6) == usual_jobs(10**6 + 1)
