"""A session on disk, and processes that write to it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from ecat.store import Session, files
from tests.store.sessions import make


class Writers:
    """The other end of :mod:`tests.store.writers`."""

    def __init__(self) -> None:
        root = Path(__file__).parents[2]
        command = [sys.executable, "-m", "tests.store.writers"]
        self.process = subprocess.Popen(
            command, cwd=root, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )

    def start(self, *words: object) -> Iterator[str]:
        """Give a command, and return its answers as they come."""
        assert self.process.stdin
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        return self._answers()

    def _answers(self) -> Iterator[str]:
        assert self.process.stdout
        while (line := self.process.stdout.readline().strip()) != "end":
            assert line, "the writers have died"
            yield line

    def run(self, *words: object) -> list[str]:
        """Give a command, and return all its answers."""
        return list(self.start(*words))


@pytest.fixture(scope="module")
def writers() -> Generator[Writers]:
    """Processes that write, and can be killed."""
    made = Writers()
    yield made
    made.process.kill()
    made.process.communicate()


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A small session whose every part carries the number 0."""
    return make(tmp_path / "session")


class Steps:
    """Counts the steps of a write, and raises ``error`` instead of step number ``fail_at``."""

    def __init__(self) -> None:
        self.count = 0
        self.fail_at: int | None = None
        self.error: OSError = OSError()

    def __call__(self, action: str, path: Path) -> None:
        self.count += 1
        if self.count - 1 == self.fail_at:
            raise self.error


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> Steps:
    """In place of :data:`ecat.store.files.step`."""
    made = Steps()
    monkeypatch.setattr(files, "step", made)
    return made
