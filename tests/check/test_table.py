"""A camera that was moved is told, and whether the places before and after can be compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pyarrow as pa
import pytest

from ecat.check import examine
from ecat.tables import TABLE_PLANE

if TYPE_CHECKING:
    from conftest import Case


@pytest.mark.parametrize(
    ("tie", "severity", "code"), [("boxes", "note", "camera-moved"), (None, "warning", "table-untied")]
)
def test_a_moved_camera_is_told(case: Case, tie: str | None, severity: str, code: str) -> None:
    row = dict.fromkeys(TABLE_PLANE.arrow.names, 0) | {"evidence": "depth", "tie": None}
    rows = [row, row | {"frame": 50, "t_ns": case.tables["poses"]["t_ns"][0].as_py(), "tie": tie}]
    case.tables["table_plane"] = pa.Table.from_pylist(rows, schema=TABLE_PLANE.arrow)
    (finding,) = [f for f in examine(case.patient) if f.place == "table table_plane"]
    assert (finding.severity, finding.code) == (severity, code)
    assert "before frame 50" in finding.message
