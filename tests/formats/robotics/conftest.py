"""Sessions that the tests of these formats read; nobody writes to them."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecat.sample import GroundTruth
from ecat.store import Session
from tests.formats.robotics.scenes import made


@pytest.fixture(scope="session")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, GroundTruth]:
    """With video, depth and sound, and the truth about it."""
    return made(tmp_path_factory.mktemp("robotics") / "filmed", pixels=True)


@pytest.fixture(scope="session")
def session(filmed: tuple[Session, GroundTruth]) -> Session:
    return filmed[0]


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Without images."""
    return made(tmp_path_factory.mktemp("robotics") / "plain", seed=6, pixels=False)[0]


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"
