"""Sessions to make data sets of."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.formats.datasets.moments import Make, maker


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Make sessions of a project."""
    return maker(tmp_path / "project")
