"""The same results wherever the work is done."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path

import pytest

from ecat.batch import engines
from ecat.batch.engines import Engine, usual_jobs
from ecat.errors import MissingExtraError

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
    if engine == "ray":
        pytest.importorskip("ray", reason="Ray is not installed: pip install 'ecat[ray]'")
    kept: list[int] = []
    found = engines.run(square, tasks, jobs=jobs, died=died, keep=kept.append, engine=engine)
    assert sorted(kept) == sorted(found)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_results_come_in_the_order_of_the_tasks(engine: Engine) -> None:
    assert results([Task(n) for n in range(30)], engine) == [n**2 for n in range(30)]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_only_the_task_that_kills_its_process_is_given_up(engine: Engine) -> None:
    tasks = [Task(n, deadly="always" if n == 3 else "") for n in range(8)]
    assert results(tasks, engine) == [0, 1, 4, -3, 16, 25, 36, 49]


@pytest.mark.slow
def test_a_process_that_was_killed_by_chance_is_not_the_end_of_its_task(tmp_path: Path) -> None:
    tasks = [Task(n, deadly="once" if n == 3 else "", marker=tmp_path / str(n)) for n in range(6)]
    assert results(tasks, "processes") == [0, 1, 4, 9, 16, 25]


def test_nothing_to_do_takes_no_process() -> None:
    assert results([], "processes") == []


def test_without_ray_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(MissingExtraError, match="cannot use --engine ray") as caught:
        engines.run(square, [Task(1)], jobs=1, died=died, keep=lambda _: None, engine="ray")
    assert "ecat[ray]" in caught.value.fix


def test_few_tasks_are_done_by_one_process() -> None:
    assert [usual_jobs(n) for n in (0, 1, 3)] == [1, 1, 1]
    assert 1 <= usual_jobs(4) <= 4
    assert usual_jobs(10**6) == usual_jobs(10**6 + 1)
