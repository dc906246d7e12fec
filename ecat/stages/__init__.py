"""Stages: pure functions from arrays or Arrow tables to Arrow tables."""

from __future__ import annotations

from ecat.stages.face_planes import FACE_PLANES_STAGE
from ecat.stages.hull import HULL
from ecat.stages.plane import PLANE
from ecat.stages.pose import POSE
from ecat.stages.propose import PROPOSE
from ecat.stages.relations import RELATIONS
from ecat.stages.smooth import SMOOTH
from ecat.stages.stage import Stage
from ecat.stages.table_depth import OUTLINE
from ecat.stages.track import TRACK

STAGES: tuple[Stage, ...] = (TRACK, FACE_PLANES_STAGE, PLANE, OUTLINE, POSE, SMOOTH, HULL, RELATIONS, PROPOSE)
"""Every stage, in the order in which they run."""

__all__ = ["STAGES", "Stage"]
