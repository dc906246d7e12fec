"""A layer to do operations on, in memory and on the disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ecat.model import Layer
from ecat.store import Draft, Session, create_session, open_session
from tests.annotate.bench import MANIFEST, Bench


@pytest.fixture
def bench() -> Bench:
    """An empty layer."""
    return Bench()


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A session without annotations."""
    return create_session(tmp_path / "session", Draft(manifest=MANIFEST))


@pytest.fixture
def reopened(session: Session) -> Callable[[], Layer]:
    """The layer ``main`` as whoever opens the session next finds it."""
    return lambda: open_session(session.path).layer()
