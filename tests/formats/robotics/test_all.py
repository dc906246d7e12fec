"""What holds of all these formats: written through the driver, stretch by stretch, and the same every time."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from ecat.formats import export, registry
from ecat.formats.robotics import tracks
from ecat.store import Session

OPTIONS = {"mcap": {"depth": "false"}, "movie": {"height": "240", "end_s": "0.4"}, "ply": {"points": "500"}}
NAMES = (
    "bvh",
    "glb",
    "mcap",
    "movie",
    "ntu-skeleton",
    "ply",
    "tum-trajectories",
    "voxml",
    "voxsim-demonstrations",
)


def digest(path: Path) -> str:
    """Of a file, or of a folder with the names of all that is in it."""
    found = hashlib.sha256()
    for file in [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file()):
        found.update(file.relative_to(path).as_posix().encode() + b"\0" + file.read_bytes())
    return found.hexdigest()


def skip_without_extra(name: str) -> None:
    if name == "mcap":
        pytest.importorskip("foxglove", reason="the extra mcap is not installed")
        pytest.importorskip("mcap")


@pytest.mark.parametrize("name", NAMES)
def test_the_same_bytes_however_many_frames_are_read_at_once(
    name: str, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    skip_without_extra(name)
    export(session.path, tmp_path / "a", format=name, options=OPTIONS.get(name))
    monkeypatch.setattr(tracks, "FRAMES_AT_ONCE", 7)
    export(session.path, tmp_path / "b", format=name, options=OPTIONS.get(name))
    assert digest(tmp_path / "a") == digest(tmp_path / "b")


@pytest.mark.parametrize("name", [*NAMES, "rrd"])
def test_the_registry_knows_it_as_something_that_is_written(name: str) -> None:
    chosen = registry.find(name)
    assert chosen.writes
    assert chosen.name == name


def test_rerun_reads_the_recording_back(plain: Session, tmp_path: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk")
    export(plain.path, tmp_path / "it.rrd", format="rrd")
    paths = {part.entity_path for part in chunk.RrdReader(str(tmp_path / "it.rrd")).stream()}
    assert {"/world/boxes/Shell", "/world/boxes/Stella_Artois"} <= paths
