"""The command line as a function, and a small session to use it on."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ecat.cli import main


@dataclass(frozen=True)
class Result:
    """What a call printed and returned."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The JSON document on stdout."""
        return json.loads(self.out)


Ecat = Callable[..., Result]


@pytest.fixture
def ecat(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Ecat:
    """Call the command line: ``ecat("info", path)``; however slow the machine, without lines of progress."""
    monkeypatch.setattr("ecat.cli.output.LINE_EVERY_S", float("inf"))

    def call(*args: object) -> Result:
        code = main([str(arg) for arg in args])
        captured = capfd.readouterr()
        return Result(code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A generated session with one action."""
    from ecat.sample import sample_session
    from ecat.store import create_session

    folder = tmp_path_factory.mktemp("cli") / "slide"
    create_session(folder, sample_session(seed=3, actions=("next",), name="slide")[0])
    return folder


@pytest.fixture
def session(made_once: Path, tmp_path: Path) -> Path:
    """A copy of the generated session, to do anything to."""
    return Path(shutil.copytree(made_once, tmp_path / "slide"))
