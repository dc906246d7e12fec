"""Which joints of a body are joined by a bone."""

from __future__ import annotations

from itertools import pairwise

_CHAINS = (
    "SpineBase SpineMid SpineShoulder Neck Head",
    "SpineShoulder ShoulderLeft ElbowLeft WristLeft HandLeft HandTipLeft",
    "SpineShoulder ShoulderRight ElbowRight WristRight HandRight HandTipRight",
    "WristLeft ThumbLeft",
    "WristRight ThumbRight",
    "SpineBase HipLeft KneeLeft AnkleLeft FootLeft",
    "SpineBase HipRight KneeRight AnkleRight FootRight",
)
BONES: tuple[tuple[str, str], ...] = tuple(pair for chain in _CHAINS for pair in pairwise(chain.split()))
"""Bones of the Kinect v2's 25 joints; of a body with other joints, those whose two ends it has."""
