"""What networks are trained on: windows of sessions with their labels, and others of which the same would be said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ecat.progress import Progress
from learn.features.points import JOINTS, SWAP_POINTS
from learn.features.raw import (
    DEPTH,
    HEIGHT,
    MIRROR_CHANNELS,
    MIRROR_SIGNS,
    N_CHANNELS,
    PLANE,
    SHAPE,
)
from learn.features.scene import UNKNOWN, lost
from learn.features.windows import HOP, LENGTH, Floats
from learn.recognize.dataset import LabelledSession, Labels, exchanged, places_of
from learn.recognize.folds import Key
from learn.recognize.inputs import Fitted
from learn.recognize.neural.training import Settings

FEWEST = 5
"""Sessions of which one says when to stop although a share of no file is one; of fewer, each is needed to learn."""
_TRUNK, _ELBOWS = [0, 1, 7], [2, 8]
"""Of joints."""


def held_out(
    sessions: Sequence[LabelledSession], settings: Settings
) -> tuple[list[LabelledSession], list[LabelledSession]]:
    """Sessions to learn from, and a share of every file that says when to stop: if that is none of any, one of them all
    where there are :data:`FEWEST` or more.
    """
    generator = np.random.default_rng(settings.seed)
    held: set[Key] = set()
    for file in sorted({session.file for session in sessions}):
        keys = [session.key for session in sessions if session.file == file]
        count = round(settings.validation * len(keys))
        held.update(keys[place] for place in generator.permutation(len(keys))[:count].tolist())
    if settings.validation and not held and len(sessions) >= FEWEST:
        held.add(sessions[int(generator.integers(len(sessions)))].key)
    known = [session for session in sessions if session.key not in held]
    return known, [session for session in sessions if session.key in held]


def twice(sessions: Sequence[LabelledSession], fitted: Fitted, progress: Progress) -> tuple[Tensor, Tensor]:
    """Windows and labels of each session, and again with the boxes exchanged."""
    inputs: list[Any] = []
    for done, session in enumerate(sessions):
        progress("computing features", done, len(sessions))
        inputs += [fitted.windows(points) for points in (session.points, session.points[:, SWAP_POINTS])]
    labels = [part for one in sessions for part in (one.labels, exchanged(one.labels))]
    return torch.from_numpy(np.concatenate(inputs)), torch.from_numpy(np.concatenate(labels))


def dense(
    sessions: Sequence[LabelledSession],
    fitted: Fitted,
    vocabulary: Labels,
    settings: Settings,
    progress: Progress,
) -> tuple[Tensor, Tensor]:
    """Windows that begin every few frames of sessions, each of which has one, as if they had taken more or less time.

    One whose middle is between those of two that are labelled has a share of either label.
    """
    inputs: list[Any] = []
    targets: list[Any] = []
    for done, session in enumerate(sessions):
        progress("computing features", done, len(sessions))
        hot = np.eye(len(vocabulary), dtype=np.float32)[places_of(session.labels, vocabulary)]
        for times in settings.durations:
            inputs.append(fitted.windows(stretched(session.points, times), settings.step))
            middle = (np.arange(len(inputs[-1])) * settings.step + LENGTH / 2) / times
            where = np.clip((middle - LENGTH / 2) / HOP, 0, len(hot) - 1)
            before = np.floor(where).astype(np.int64)
            share = (where - before).astype(np.float32)[:, None]
            targets.append((1 - share) * hot[before] + share * hot[np.minimum(before + 1, len(hot) - 1)])
    return torch.from_numpy(np.concatenate(inputs)), torch.from_numpy(np.concatenate(targets))


def stretched(points: Floats, times: float) -> Floats:
    """A session's points (n, 21, 3) as if all had taken ``times`` as long, in as many frames a second.

    From where a point was seen to where it was seen next it goes straight; otherwise it is as in the nearest frame.
    """
    at = np.arange(int((len(points) - 1) * times) + 1) / times
    before = np.floor(at).astype(np.int64)
    after = np.minimum(before + 1, len(points) - 1)
    share = (at - before)[:, None, None]
    seen = np.isfinite(points).all(axis=2) & (points != UNKNOWN).any(axis=2)
    seen[:, len(JOINTS) :] &= ~lost(points[:, len(JOINTS) :])
    between = points[before] * (1 - share) + points[after] * share
    nearest = points[np.where(at - before < 0.5, before, after)]
    return np.where((seen[before] & seen[after])[..., None], between, nearest)


class Augment:
    """Other scenes of which the same would be said, so that nothing else is learned of those that were recorded.

    They are seen in a mirror, and from any side; the person is elsewhere, and larger or smaller, as are the boxes; the
    table slopes otherwise, and every point is off by as much throughout the window, and by a little in every frame.
    """

    tilt, growth, size = 0.07, 0.08, 0.1
    torso_m, apart_m, joint_m, box_m, height_m, depth_m, noise_m = 0.15, 0.03, 0.02, 0.01, 0.03, 0.05, 0.003

    def __init__(self) -> None:
        self.signs = torch.from_numpy(MIRROR_SIGNS)
        self.with_torso = torch.zeros(len(JOINTS), 1)
        self.with_torso[_TRUNK], self.with_torso[_ELBOWS] = 1.0, 0.5

    def __call__(self, inputs: Tensor) -> Tensor:
        """Other windows (b, 20, 75)."""
        n = len(inputs)
        mirrored = torch.rand(n, 1, 1) < 0.5
        x = torch.where(mirrored, inputs[..., MIRROR_CHANNELS] * self.signs, inputs)
        plane = self._from_a_side(x[..., PLANE].unflatten(2, (-1, 2)))
        shape = x[..., SHAPE] * (1 + self.size * torch.randn(n, 1, 1))
        height = x[..., HEIGHT] + self.height_m * (
            torch.randn(n, 1, 1) + 0.5 * torch.randn(n, 1, len(JOINTS))
        )
        depth = x[..., DEPTH] + self.depth_m * torch.randn(n, 1, 4)
        larger = 1 + self.growth * torch.randn(n, 1, 1)
        found = torch.cat(
            [(plane * larger[..., None] + self._away(n)).flatten(2), shape, height, depth], dim=2
        )
        found[..., PLANE.stop :] *= larger
        return found + self.noise_m * (torch.randn_like(found) + torch.randn(n, 1, N_CHANNELS))

    def _from_a_side(self, plane: Tensor) -> Tensor:
        """Places (b, 20, 21, 2) on a table that slopes otherwise, turned about the middle of both boxes."""
        n = len(plane)
        along = 1 + self.tilt * torch.randn(n)
        angle = math.pi * (2 * torch.rand(n) - 1)
        cos, sin = angle.cos(), angle.sin()
        return plane @ torch.stack([cos, sin, -sin * along, cos * along], dim=1).view(n, 1, 2, 2)

    def _away(self, n: int) -> Tensor:
        """How far (b, 1, 21, 2) points are from where they were: the person, the upper body, joints, and boxes."""
        person, torso = self.apart_m * torch.randn(n, 1, 1, 2), self.torso_m * torch.randn(n, 1, 1, 2)
        joints = person + torso * self.with_torso + self.joint_m * torch.randn(n, 1, len(JOINTS), 2)
        boxes = self.box_m * torch.randn(n, 1, 2, 2)
        return torch.cat([joints, boxes.repeat_interleave(4, dim=2)], dim=2)
