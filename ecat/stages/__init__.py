"""Stages: pure functions from arrays or Arrow tables to Arrow tables."""

from __future__ import annotations

from ecat.stages.plane import PLANE
from ecat.stages.pose import POSE
from ecat.stages.propose import PROPOSE
from ecat.stages.relations import RELATIONS
from ecat.stages.smooth import SMOOTH
from ecat.stages.stage import Stage
from ecat.stages.track import TRACK

STAGES: tuple[Stage, ...] = (TRACK, PLANE, POSE, SMOOTH, RELATIONS, PROPOSE)
"""Every stage, in the order in which they run."""

__all__ = ["STAGES", "Stage"]
