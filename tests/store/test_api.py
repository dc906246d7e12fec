"""``import ecat`` is small and quick."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import ecat
from ecat import store
from tests.store.sessions import make


def test_the_public_names_are_these() -> None:
    assert ecat.__all__ == ["EcatError", "Project", "Session", "open_project", "open_session"]
    assert all(hasattr(ecat, name) for name in ecat.__all__)
    assert set(ecat.__all__) <= set(dir(ecat))
    assert ecat.open_session is store.open_session
    assert all(hasattr(store, name) for name in store.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        ecat.nonsense  # noqa: B018 - reading it is the test


def test_the_example_of_the_docstring_works(tmp_path: Path) -> None:
    make(tmp_path / "session", n=1500)
    session = ecat.open_session(str(tmp_path / "session"))
    assert session.events.to_pandas()["event_id"].tolist() == ["e1"]
    assert session.table("poses", start=10.0, end=40.0).to_arrow().num_rows == 900


def test_importing_it_imports_no_other_library() -> None:
    code = "import sys, ecat; print(sorted({m.split('.')[0] for m in sys.modules} & set(sys.argv[1:])))"
    heavy = ["pyarrow", "pandas", "numpy", "pydantic", "lxml", "cv2", "scipy", "rerun", "torch"]
    found = subprocess.run([sys.executable, "-c", code, *heavy], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
