"""What networks are trained on: windows of sessions with their labels, and others of which the same would be said."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ecat.progress import Progress
from learn.features.points import SWAP_POINTS
from learn.features.raw import (
    DEPTH,
    HEIGHT,
    MIRROR_CHANNELS,
    MIRROR_SIGNS,
    N_CHANNELS,
    PLANE,
    SHAPE,
    SWAP_CHANNELS,
)
from learn.features.windows import HOP
from learn.recognize.dataset import LabelledSession, Labels, exchanged, places_of
from learn.recognize.folds import Key
from learn.recognize.inputs import Fitted
from learn.recognize.neural.training import Settings


def held_out(
    sessions: Sequence[LabelledSession], settings: Settings
) -> tuple[list[LabelledSession], list[LabelledSession]]:
    """Sessions to learn from, and a share of every file that says when to stop."""
    generator = np.random.default_rng(settings.seed)
    held: set[Key] = set()
    for file in sorted({session.file for session in sessions}):
        keys = [session.key for session in sessions if session.file == file]
        count = round(settings.validation * len(keys))
        held.update(keys[place] for place in generator.permutation(len(keys))[:count].tolist())
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
    sessions: Sequence[LabelledSession], fitted: Fitted, vocabulary: Labels, step: int, progress: Progress
) -> tuple[Tensor, Tensor]:
    """Windows that begin every few frames; one between two that are labelled has a share of either label."""
    inputs: list[Any] = []
    targets: list[Any] = []
    for done, session in enumerate(sessions):
        progress("computing features", done, len(sessions))
        inputs.append(fitted.windows(session.points, step))
        hot = np.eye(len(vocabulary), dtype=np.float32)[places_of(session.labels, vocabulary)]
        where = np.arange(len(inputs[-1])) * step / HOP
        before = np.floor(where).astype(np.int64)
        share = (where - before).astype(np.float32)[:, None]
        targets.append((1 - share) * hot[before] + share * hot[np.minimum(before + 1, len(hot) - 1)])
    return torch.from_numpy(np.concatenate(inputs)), torch.from_numpy(np.concatenate(targets))


class Augment:
    """Other scenes of which the same would be said: boxes exchanged, in a mirror, turned, larger, and noisier."""

    turn, growth, apart_m, noise_m = 0.2, 0.08, 0.02, 0.003

    def __init__(self, vocabulary: Labels) -> None:
        self.exchange = torch.tensor(places_of(exchanged(vocabulary), vocabulary))
        self.signs = torch.from_numpy(MIRROR_SIGNS)

    def __call__(self, inputs: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Another batch of windows (b, 20, 75) and shares of labels (b, k)."""
        n = len(inputs)
        mirrored, swapped = torch.rand(2, n) < 0.5
        x = torch.where(mirrored[:, None, None], inputs[..., MIRROR_CHANNELS] * self.signs, inputs)
        x = torch.where(swapped[:, None, None], x[..., SWAP_CHANNELS], x)
        plane = x[..., PLANE].unflatten(2, (-1, 2))
        angle = self.turn * torch.randn(n)
        cos, sin = angle.cos(), angle.sin()
        turns = torch.stack([cos, sin, -sin, cos], dim=1).view(n, 1, 2, 2)
        plane = plane @ turns
        away = torch.zeros(n, 1, plane.shape[2], 2)
        away[:, :, :13] = self.apart_m * torch.randn(n, 1, 1, 2)
        rest = [x[..., part] for part in (SHAPE, HEIGHT, DEPTH)]
        grown = torch.cat([plane.flatten(2), *rest], dim=2) * (1 + self.growth * torch.randn(n, 1, 1))
        grown[..., PLANE] += away.flatten(2)
        noise = torch.randn_like(grown) + torch.randn(n, 1, N_CHANNELS)
        return grown + self.noise_m * noise, torch.where(swapped[:, None], targets[:, self.exchange], targets)
