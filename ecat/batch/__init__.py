"""Many sessions at once: a session is the unit of work, done here, in other processes, or on other machines."""

from __future__ import annotations

from ecat.batch.engines import Engine, usual_jobs
from ecat.batch.exporting import export_sessions
from ecat.batch.processing import Outcome, process_sessions
from ecat.batch.shards import Shard, parse_shard

__all__ = ["Engine", "Outcome", "Shard", "export_sessions", "parse_shard", "process_sessions", "usual_jobs"]
