"""Whether places on the table mean the same throughout the recording."""

from __future__ import annotations

from collections.abc import Iterator

from ecat.check.finding import Check, Finding, Patient, note, warning
from ecat.stages.tie import cuts


def camera_moves(patient: Patient) -> Iterator[Finding]:
    """Where the camera was moved, and whether the frames of the table before and after have something in common."""
    plane = patient.table("table_plane")
    if plane is None or plane.num_rows < 2:
        return
    rows = sorted(plane.to_pylist(), key=lambda row: int(row["frame"]))
    untied = set(cuts(plane))
    for row in rows[1:]:
        frame = int(row["frame"])
        moved = f"the camera was moved before frame {frame}"
        if frame in untied:
            message = f"{moved}, and nothing seen ties the table's frames: places before and after are not comparable"
            yield warning("table-untied", "table table_plane", message)
        else:
            yield note(
                "camera-moved", "table table_plane", f"{moved}; the table's frames are tied by: {row['tie']}"
            )


TABLE: tuple[Check, ...] = (camera_moves,)
"""The checks of where the table is."""
