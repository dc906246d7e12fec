"""Running stages on a session: what is out of date, and nothing else.

Every derived table records the stage, its version, its parameters and the hashes of what it was made from.  A stage
whose record matches is skipped.
"""

from __future__ import annotations

from ecat.process.graph import ProcessReport, process_session, stage_names, stale_tables
from ecat.process.prototypes import calibrate, calibrate_together, read_prototypes, write_prototypes

__all__ = [
    "ProcessReport",
    "calibrate",
    "calibrate_together",
    "process_session",
    "read_prototypes",
    "stage_names",
    "stale_tables",
    "write_prototypes",
]
