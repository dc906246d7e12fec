"""The command line as a function, and a small session to use it on."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.command_line import Ecat, Result, ecat

__all__ = ["Ecat", "Result", "ecat"]


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
