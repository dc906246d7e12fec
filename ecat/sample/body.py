"""A seated performer: 25 Kinect joints (ECAT 2018 file format §1.3) with a fixed torso and two-bone arms."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np

from ecat.formats.ecat2018.body_scheme import KINECT_V2
from ecat.geometry.transforms import Floats

Hand: TypeAlias = Literal["HandLeft", "HandRight"]
HANDS: tuple[Hand, ...] = get_args(Hand)
JOINTS: tuple[str, ...] = tuple(joint.name for joint in KINECT_V2.joints)
"""Names by joint id."""

UPPER_ARM_M = 0.31
FOREARM_M = 0.37
"""From the elbow to the middle of the hand."""
HAND_M = 0.09
"""From the wrist to the middle of the hand."""

_TORSO = {
    "SpineBase": (0.0, 0.6, -0.12), "SpineMid": (0.0, 0.53, 0.13), "SpineShoulder": (0.0, 0.36, 0.38),
    "Neck": (0.0, 0.34, 0.44), "Head": (0.0, 0.29, 0.57), "Shoulder": (-0.17, 0.31, 0.34),
    "Hip": (-0.08, 0.6, -0.16), "Knee": (-0.14, 0.2, -0.2),
    "Ankle": (-0.13, 0.26, -0.6), "Foot": (-0.13, 0.14, -0.65),
}  # fmt: skip
_REST = (-0.47, 0.29, 0.03)
_ELBOW_HINT = (-0.6, 0.5, -0.6)


def _side(point: tuple[float, float, float], hand: Hand) -> Floats:
    """A point told for the right side, on the side of ``hand``."""
    return np.array(point) * (np.array([-1.0, 1.0, 1.0]) if hand == "HandLeft" else 1.0)


def shoulder(hand: Hand, scale: float, sway_m: float) -> Floats:
    """Shoulder (3,) of ``hand``'s arm, table frame, metres."""
    return _side(_TORSO["Shoulder"], hand) * scale + np.array([sway_m, 0.0, 0.0])


def resting(hand: Hand) -> Floats:
    """Where a hand (3,) rests on the table beside the working area, table frame, metres."""
    return _side(_REST, hand)


def reach_m(scale: float) -> float:
    """The greatest distance between shoulder and hand that leaves the elbow a little bent, metres."""
    return 0.99 * (UPPER_ARM_M + FOREARM_M) * scale


def skeleton(hands: Floats, scale: float, sway_m: float) -> Floats:
    """Joints (n, 25, 3), table frame, metres, for hand positions (2, n, 3) in the order of ``HANDS``."""
    joints = np.empty((hands.shape[1], len(JOINTS), 3))
    for name in ("SpineBase", "SpineMid", "SpineShoulder", "Neck", "Head"):
        joints[:, JOINTS.index(name)] = np.array(_TORSO[name]) * scale + np.array([sway_m, 0.0, 0.0])
    for hand, path in zip(HANDS, hands, strict=True):
        side = hand.removeprefix("Hand")
        for name in ("Hip", "Knee", "Ankle", "Foot"):
            joints[:, JOINTS.index(name + side)] = _side(_TORSO[name], hand) * scale
        for name, points in _arm(path, hand, scale, sway_m).items():
            joints[:, JOINTS.index(name + side)] = points
    return joints


def _arm(path: Floats, hand: Hand, scale: float, sway_m: float) -> dict[str, Floats]:
    """Joints (n, 3) of one arm whose hand follows ``path`` (n, 3): the elbow by the law of cosines."""
    upper, fore = UPPER_ARM_M * scale, FOREARM_M * scale
    start = shoulder(hand, scale, sway_m)
    gap = path - start
    length = np.sqrt((gap * gap).sum(-1, keepdims=True))
    along = gap / length
    hint = _side(_ELBOW_HINT, hand)
    aside = hint - (along * hint).sum(-1, keepdims=True) * along
    aside = aside / np.sqrt((aside * aside).sum(-1, keepdims=True))
    foot = (upper**2 - fore**2 + length**2) / (2 * length)
    elbow = start + foot * along + np.sqrt(np.maximum(upper**2 - foot**2, 0)) * aside
    bone = (path - elbow) / fore
    inward = _side((1.0, -0.3, -0.2), hand)
    return {
        "Shoulder": np.broadcast_to(start, path.shape),
        "Elbow": elbow,
        "Wrist": path - HAND_M * bone,
        "Hand": path,
        "HandTip": path + (0.07 * bone + np.array([0.0, -0.02, -0.02])) * scale,
        "Thumb": path + (0.03 * bone + 0.035 * inward) * scale,
    }
