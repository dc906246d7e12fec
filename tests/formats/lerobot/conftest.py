"""Data sets to look at: exported by the same call as on the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from ecat import formats
from tests.formats.lerobot.recordings import Recording, make


@dataclass(frozen=True)
class DataSet:
    """A LeRobot data set on the disk, read with nothing but pyarrow and PyAV."""

    root: Path
    findings: tuple[str, ...]

    @property
    def info(self) -> dict[str, Any]:
        """``meta/info.json``."""
        return json.loads((self.root / "meta/info.json").read_bytes())

    @property
    def stats(self) -> dict[str, Any]:
        """``meta/stats.json``."""
        return json.loads((self.root / "meta/stats.json").read_bytes())

    @property
    def how(self) -> dict[str, Any]:
        """``meta/ecat.json``."""
        return json.loads((self.root / "meta/ecat.json").read_bytes())

    @property
    def rows(self) -> pa.Table:
        """All rows of ``data``."""
        return pa.concat_tables(pq.read_table(path) for path in sorted(self.root.glob("data/*/*.parquet")))

    @property
    def episodes(self) -> list[dict[str, Any]]:
        """All rows of ``meta/episodes``."""
        return [
            row
            for path in sorted(self.root.glob("meta/episodes/*/*"))
            for row in pq.read_table(path).to_pylist()
        ]

    def column(self, name: str) -> NDArray[Any]:
        """A column of ``data``, (n,) or (n, k)."""
        return np.array(self.rows[name].to_pylist())

    def images(self, key: str, file: str = "chunk-000/file-000.mp4") -> list[NDArray[Any]]:
        """The decoded images of a video file: RGB, or the codes of depth."""
        import av

        kind = "gray12le" if "depth" in key else "rgb24"
        with av.open(str(self.root / "videos" / key / file)) as container:
            return [frame.to_ndarray(format=kind) for frame in container.decode(video=0)]

    def files(self) -> dict[str, bytes]:
        """Everything, byte by byte."""
        paths = sorted(path for path in self.root.rglob("*") if path.is_file())
        return {path.relative_to(self.root).as_posix(): path.read_bytes() for path in paths}


Export = Callable[..., DataSet]


@pytest.fixture
def export(tmp_path: Path) -> Export:
    """Export recordings with options: ``export(Recording(...), ..., fps="15")``."""

    def run(*recordings: Recording, to: str = "out", **options: str) -> DataSet:
        project = tmp_path / "project"
        if not project.exists():
            project.mkdir()
            (project / "project.json").write_text(
                json.dumps({"schema_version": 1, "name": "p", "created": "2026-01-01T00:00:00Z"})
            )
            for recording in recordings:
                make(project, recording)
        report = formats.export(project, tmp_path / to, format="lerobot", options=options)
        return DataSet(tmp_path / to, report.findings)

    return run
