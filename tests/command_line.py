"""The command line as a function."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
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
