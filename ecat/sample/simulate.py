"""Play a script: poses, hands, joints and what the camera could see, at every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.boxes import box_corners
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.session import Clock
from ecat.sample.body import HANDS, JOINTS, resting, skeleton
from ecat.sample.motion import State, box_quaternion, minimum_jerk
from ecat.sample.scene import BOXES, HALF_M, TABLE_OUTLINE_M, Scene
from ecat.sample.script import Carry, Move
from ecat.sample.truth import GroundTruth

BOX_IDS = ("o2", "o3")
MIN_FACING = 0.17
"""Faces seen at a flatter angle than 80 degrees are not read."""
_APPROACH_M = 0.04
_HAND_PARTS = (("Hand", 0.045), ("HandTip", 0.03), ("Thumb", 0.02))
_ARM_RADIUS_M = 0.04


def simulate(
    *, name: str, seed: int, clock: Clock, scene: Scene, start: State, moves: tuple[Move, ...], n_frames: int
) -> GroundTruth:
    """The truth of a whole session."""
    boxes = _play_boxes(start, moves, n_frames)
    poses = Rigid.from_quaternion(boxes.quaternion, boxes.position)
    joints = skeleton(_play_hands(moves, poses, n_frames), scene.scale, scene.sway_m)
    corners = np.stack(
        [
            np.einsum("nij,fkj->nfki", turn, box_corners(box)) + place[:, None, None]
            for box, turn, place in zip(BOXES, poses.rotation, poses.translation, strict=True)
        ]
    )
    facing, hidden = _hidden_faces(scene, poses, corners, joints)
    return GroundTruth(
        name=name,
        seed=seed,
        clock=clock,
        n_frames=n_frames,
        scene=scene,
        object_ids=BOX_IDS,
        prototypes=BOXES,
        position=boxes.position,
        quaternion=boxes.quaternion,
        lift_m=boxes.lift,
        tilt_rad=boxes.tilt,
        holder=boxes.holder,
        joints=joints,
        moves=moves,
        corners=corners,
        facing=facing,
        hidden=hidden,
        joint_hidden=_hidden_joints(scene, poses, joints),
    )


# ----------------------------------------------------------------------------------------------- motion


@dataclass(frozen=True)
class _Boxes:
    position: Floats
    quaternion: Floats
    lift: Floats
    tilt: Floats
    holder: NDArray[np.int8]


def _play_boxes(start: State, moves: tuple[Move, ...], n: int) -> _Boxes:
    position = np.empty((2, n, 3))
    position[..., :2], position[..., 2] = start.xy[:, None], HALF_M
    yaw, tilt, lift = np.repeat(start.yaw[:, None], n, 1), np.zeros((2, n)), np.zeros((2, n))
    holder = np.full((2, n), -1, np.int8)
    for move in moves:
        for carry in move.carries:
            tau = np.arange(carry.still - carry.move + 1) / (carry.still - carry.move)
            s = carry.share[0] + (carry.share[1] - carry.share[0]) * minimum_jerk(tau)
            if carry.share != (0.0, 1.0):
                s[[0, -1]] = carry.share
            for track, values in zip((position, yaw, tilt, lift), move.path.at(s), strict=True):
                track[move.box, carry.move : carry.still] = values[:-1]
                track[move.box, carry.still :] = values[-1]
            holder[move.box, carry.grasp : carry.retreat] = HANDS.index(move.hand)
    return _Boxes(position, box_quaternion(yaw, tilt), lift, tilt, holder)


def _play_hands(moves: tuple[Move, ...], poses: Rigid, n: int) -> Floats:
    """Hand positions (2, n, 3): resting unless they carry."""
    hands = np.repeat(np.stack([resting(hand) for hand in HANDS])[:, None], n, 1)
    for move in moves:
        for carry in move.carries:
            box = Rigid(poses.rotation[move.box], poses.translation[move.box])
            path = hands[HANDS.index(move.hand)]
            _play_carry(path, carry, box)
    return hands


def _play_carry(path: Floats, carry: Carry, box: Rigid) -> None:
    """Reach over the table, close, follow the box rigidly, open, retreat; writes into ``path`` (n, 3)."""
    grip = box.rotation[carry.hold].T @ np.array(carry.grip)
    held = np.arange(carry.hold, carry.release)
    path[held] = np.einsum("nij,j->ni", box.rotation[held], grip) + box.translation[held]
    rest, first, last = path[carry.reach].copy(), path[carry.hold].copy(), path[carry.release - 1].copy()
    open_hand = np.array([0.0, _APPROACH_M, _APPROACH_M])
    for begin, end, a, b, rise in (
        (carry.reach, carry.grasp, rest, first + open_hand, 0.06),
        (carry.grasp, carry.hold, first + open_hand, first, 0.0),
        (carry.release, carry.retreat, last, last + open_hand, 0.0),
        (carry.retreat, carry.end, last + open_hand, rest, 0.06),
    ):
        tau = (np.arange(end - begin) / (end - begin))[:, None]
        over = np.array([0.0, 0.0, rise]) * 16 * (tau * (1 - tau)) ** 2
        path[begin:end] = a + (b - a) * minimum_jerk(tau) + over


# ------------------------------------------------------------------------------------------- visibility


def _hidden_faces(
    scene: Scene, poses: Rigid, corners: Floats, joints: Floats
) -> tuple[Floats, NDArray[np.int8]]:
    """Cosine to the camera and index into ``HIDERS`` (boxes, frames, faces)."""
    facing, hidden = np.empty(corners.shape[:3]), np.zeros(corners.shape[:3], np.int8)
    for b in range(2):
        centre = corners[b].mean(-2)
        _, right, low, _ = np.moveaxis(corners[b], -2, 0)
        normal = np.cross(right - low, corners[b, :, :, 0] - right)
        to_eye = scene.eye - centre
        facing[b] = (normal * to_eye).sum(-1) / np.sqrt((normal**2).sum(-1) * (to_eye**2).sum(-1))
        # nine points of every marker: corners, middles of the edges, centre
        points = np.concatenate(
            [corners[b], (corners[b] + np.roll(corners[b], 1, -2)) / 2, centre[:, :, None]], -2
        )
        flat = points.reshape(len(points), -1, 3)
        other = Rigid(poses.rotation[1 - b], poses.translation[1 - b])
        hidden[b][_any(_behind_arms(scene.eye, flat, joints), points)] = 3
        hidden[b][_any(behind_box(scene.eye, flat, other), points)] = 2
        hidden[b][facing[b] < MIN_FACING] = 1
    return facing, hidden


def _any(behind: NDArray[np.bool_], points: Floats) -> NDArray[np.bool_]:
    return np.any(behind.reshape(points.shape[:-1]), axis=-1)


def _hidden_joints(scene: Scene, poses: Rigid, joints: Floats) -> NDArray[np.bool_]:
    """(frames, 25) whether a box or the table top is between camera and joint."""
    share = scene.eye[2] / (scene.eye[2] - joints[..., 2])
    low, high = TABLE_OUTLINE_M[:, :2].min(0), TABLE_OUTLINE_M[:, :2].max(0)
    crossing = scene.eye[:2] + share[..., None] * (joints[..., :2] - scene.eye[:2])
    hidden = (joints[..., 2] < 0) & ((crossing > low) & (crossing < high)).all(-1)
    for b in range(2):
        hidden |= behind_box(scene.eye, joints, Rigid(poses.rotation[b], poses.translation[b]))
    return hidden


def behind_box(eye: Floats, points: Floats, box: Rigid) -> NDArray[np.bool_]:
    """Whether sight lines to points (n, k, 3) cross the cube (n) before they arrive (n, k); slab method."""
    start = (eye - box.translation)[:, None] @ box.rotation
    way = (points - box.translation[:, None]) @ box.rotation - start
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (-HALF_M - start) / way, (HALF_M - start) / way
    enter, leave = np.minimum(one, two).max(-1), np.maximum(one, two).min(-1)
    return (enter < leave) & (leave > 0) & (enter < 1 - 1e-6)


def _behind_arms(eye: Floats, points: Floats, joints: Floats) -> NDArray[np.bool_]:
    """Whether hands or forearms, as rows of spheres, are before points (n, k, 3) -> (n, k)."""
    behind = np.zeros(points.shape[:2], bool)
    way = points - eye
    length2 = (way * way).sum(-1)
    for side in ("Left", "Right"):
        parts = [(joints[:, JOINTS.index(part + side)], radius) for part, radius in _HAND_PARTS]
        wrist, elbow = (joints[:, JOINTS.index(part + side)] for part in ("Wrist", "Elbow"))
        parts += [(wrist + t * (elbow - wrist), _ARM_RADIUS_M) for t in np.linspace(0, 1, 6)]
        for centre, radius in parts:
            ball = (centre - eye)[:, None]
            share = (way * ball).sum(-1) / length2
            miss2 = ((share[..., None] * way - ball) ** 2).sum(-1)
            behind |= (miss2 < radius**2) & (share < 1)
    return behind
