"""The frame that chapter 4's features are made of: 21 points, in the axes of the Kinect's camera space.

Thirteen joints of a performer's arms, then four corners of one marker of each box (thesis chapter 4).
"""

from __future__ import annotations

import numpy as np

JOINTS = (
    "SpineShoulder",
    *(f"{part}Left" for part in ("Shoulder", "Elbow", "Wrist", "Hand", "HandTip", "Thumb")),
    *(f"{part}Right" for part in ("Shoulder", "Elbow", "Wrist", "Hand", "HandTip", "Thumb")),
)
N_POINTS = len(JOINTS) + 8
SWAP_POINTS = np.r_[0:13, 17:21, 13:17]
"""Where each point comes from when the two boxes are exchanged: ``points[..., SWAP_POINTS, :]``."""
KINECT_FROM_CAMERA = np.array([-1.0, -1.0, 1.0])
"""Times a point in the axes of ``camera/<name>``: x to the Kinect's left, y up."""
