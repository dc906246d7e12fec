"""Running stages on sessions: what is out of date, and nothing else.

Every derived table records the stage, its version, its parameters and the hashes of what it was made from.  A stage
whose record matches is skipped.
"""

from __future__ import annotations

from ecat.process.graph import made_by, require_stages, stage_names, stale_tables
from ecat.process.prototypes import (
    calibrate,
    calibrate_together,
    kept_prototypes,
    read_prototypes,
    to_be_tracked,
    write_prototypes,
)
from ecat.process.running import ProcessReport, process_session

__all__ = [
    "ProcessReport",
    "calibrate",
    "calibrate_together",
    "kept_prototypes",
    "made_by",
    "process_session",
    "read_prototypes",
    "require_stages",
    "stage_names",
    "stale_tables",
    "to_be_tracked",
    "write_prototypes",
]
