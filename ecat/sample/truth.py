"""What really happened in a sample: everything that a session's tables only hint at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype
from ecat.model.session import Clock
from ecat.sample.motion import box_gap
from ecat.sample.scene import Scene
from ecat.sample.script import Move

HIDERS = ("", "turned away", "other box", "hand")
"""Why a marker face cannot be seen, by the numbers in ``GroundTruth.hidden``; empty: it can."""
LIFTED_M = 0.001
TILTED_RAD = 0.01
"""A cube lifted or tilted by more than these is ``free``, otherwise it rests on the table."""


@dataclass(frozen=True, kw_only=True)
class GroundTruth:
    """The exact state of the world at every frame.

    Parameters
    ----------
    name, seed, clock, n_frames : the session's.
    scene : camera, table and performer.
    object_ids, prototypes : of each box.
    position : (boxes, frames, 3) centres in the ``table`` frame, metres.
    quaternion : (boxes, frames, 4) orientations in the ``table`` frame, x, y, z, w.
    lift_m, tilt_rad : (boxes, frames) height of the lowest point over the table, angle from upright.
    holder : (boxes, frames) index into ``HANDS`` of the hand that grasps the box, -1 for none.
    joints : (frames, 25, 3) in the ``table`` frame, metres.
    moves : what happens when.
    corners : (boxes, frames, faces, 4, 3) of the markers in the ``table`` frame, in their own order, metres.
    facing : (boxes, frames, faces) cosine between a face's normal and the direction to the camera.
    hidden : (boxes, frames, faces) index into ``HIDERS``.
    joint_hidden : (frames, 25) whether a box or the table is before the joint.
    """

    name: str
    seed: int
    clock: Clock
    n_frames: int
    scene: Scene
    object_ids: tuple[str, ...]
    prototypes: tuple[BoxPrototype, ...]
    position: Floats
    quaternion: Floats
    lift_m: Floats
    tilt_rad: Floats
    holder: NDArray[np.int8]
    joints: Floats
    moves: tuple[Move, ...]
    corners: Floats
    facing: Floats
    hidden: NDArray[np.int8]
    joint_hidden: NDArray[np.bool_]

    @cached_property
    def poses(self) -> Rigid:
        """Table-from-box transforms (boxes, frames)."""
        return Rigid.from_quaternion(self.quaternion, self.position)

    @cached_property
    def pixels(self) -> Floats:
        """Marker corners (boxes, frames, faces, 4, 2) in the colour image, px."""
        return self.scene.pixels(self.corners)

    @cached_property
    def gap_m(self) -> Floats:
        """Free distance (frames,) between the two boxes, metres."""
        (a, b), turn = self.position, self.poses.rotation
        return box_gap(Rigid(turn[0], a), Rigid(turn[1], b))

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(boxes, frames) whether the box is on its way."""
        moving = np.zeros(self.lift_m.shape, bool)
        for move in self.moves:
            for carry in move.carries:
                moving[move.box, carry.move : carry.still] = True
        return moving

    @property
    def free(self) -> NDArray[np.bool_]:
        """(boxes, frames) whether the box is lifted or tilted."""
        return (self.lift_m > LIFTED_M) | (np.abs(self.tilt_rad) > TILTED_RAD)

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Time (frames,) of every frame, nanoseconds."""
        return np.array([self.clock.t_ns(frame, self.n_frames) for frame in range(self.n_frames)], np.int64)


def runs(states: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open intervals in which a state (frames,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], states, [False]])))
    return [(int(start), int(end)) for start, end in edges.reshape(-1, 2)]
