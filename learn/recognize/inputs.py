"""What networks are fed, by name: the thesis' sets of features, and raw points; fitted to training sessions only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError
from learn.features.ch4 import (
    Projection,
    Projections,
    event75,
    fit_projections,
    pcas,
    qsr25,
    sparse522,
)
from learn.features.points import JOINTS
from learn.features.raw import N_CHANNELS, raw_channels
from learn.features.raw import VERSION as RAW
from learn.features.windows import HOP, LENGTH, Floats, Table, fit_table, n_windows

Inputs = NDArray[np.float32]
SHAPES: dict[str, tuple[int, ...]] = {
    "ch4-pcas18": (LENGTH, 18),
    "ch4-qsr25": (LENGTH, 25),
    "ch4-sparse522": (LENGTH, 522),
    "ch4-event75": (75,),
    RAW: (LENGTH, N_CHANNELS),
}
"""Of the inputs of a window."""
_PLACES = slice(0, len(JOINTS))


@dataclass(frozen=True)
class Fitted:
    """A set of features with what was fitted to the sessions that a network is trained on.

    Attributes
    ----------
    name : one of :data:`SHAPES`.
    fit : the projections of chapter 4 (mean and axes of two planes, 18 numbers), or the table (slope and height) and
        where joints usually are, which stand in for those of a session in which nobody was seen.

    Raises
    ------
    ValueError : it is of another set.
    """

    name: str
    fit: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = 2 + 3 * len(JOINTS) if self.name == RAW else 18
        if self.fit.shape != (n,) or not np.isfinite(self.fit).all():
            raise ValueError(f"what was fitted to {self.name} is not {n} numbers")

    @classmethod
    def of(cls, name: str, sessions: Sequence[Floats]) -> Fitted:
        """Fitted to sessions, each of points (n, 21, 3).

        Raises
        ------
        InputError : there are too few points.
        """
        points = np.concatenate(sessions)
        if name == RAW:
            table = fit_table(points)
            seen = points[:, _PLACES][np.isfinite(points[:, _PLACES]).all(axis=(1, 2))]
            joints = np.median(seen, axis=0) if len(seen) else np.zeros((len(JOINTS), 3))
            return cls(name, np.concatenate([[table.slope, table.height], joints.ravel()]))
        planes = fit_projections(points)
        parts = [(plane.mean, plane.components) for plane in (planes.inter, planes.intra)]
        return cls(name, np.concatenate([part.ravel() for pair in parts for part in pair]))

    def windows(self, points: Floats, step: int = HOP) -> Inputs:
        """Inputs (w, ...) of the windows of a session (n, 21, 3), which begin every ``step`` frames."""
        last = HOP * n_windows(len(points)) - HOP
        frames = np.arange(0, last + 1, step)[:, None] + np.arange(LENGTH)
        if self.name == RAW:
            if not np.isfinite(points[:, _PLACES]).any():
                points = np.concatenate(
                    [np.tile(self.fit[2:].reshape(-1, 3), (len(points), 1, 1)), points[:, len(JOINTS) :]],
                    axis=1,
                )
            return raw_channels(points[frames], Table(*self.fit[:2].tolist()))
        places = pcas(_known(points), self._planes())
        if self.name == "ch4-pcas18":
            return places[frames].astype(np.float32)
        codes = qsr25(places)
        if self.name == "ch4-sparse522":
            return sparse522(codes)[frames].astype(np.float32)
        found = codes[frames]
        return (event75(found) if self.name == "ch4-event75" else found).astype(np.float32)

    def on_table(self, table: Table) -> Fitted:
        """The same where the table is known, if it is what was fitted."""
        if self.name != RAW:
            return self
        return Fitted(self.name, np.concatenate([[table.slope, table.height], self.fit[2:]]))

    def _planes(self) -> Projections:
        inter, intra = (Projection(one[:3], one[3:].reshape(2, 3)) for one in (self.fit[:9], self.fit[9:]))
        return Projections(inter, intra)


def _known(points: Floats) -> Floats:
    """The points, and where one is not known that of the nearest earlier frame, or else of the next.

    Raises
    ------
    InputError : a point is known nowhere.
    """
    known = np.isfinite(points)
    if known.all():
        return points
    if not known.any(axis=0).all():
        raise InputError(
            "cannot compute the features of a session",
            where="a joint or a corner was never seen",
            consequence="nothing was computed",
            fix="leave the session out",
        )
    frame = np.arange(len(points))[:, None, None]
    before = np.maximum.accumulate(np.where(known, frame, -1), axis=0)
    first = known.argmax(axis=0)
    return np.take_along_axis(points, np.where(before >= 0, before, first), axis=0)
