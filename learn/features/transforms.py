"""Transforms that are fitted to recordings: what was fitted to some, and to no others, is applied to any.

planes = PcaPlanes.fit(training)
places = [planes.apply(recording) for recording in test]
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError, InputError, NotFoundError
from ecat.process.inputs import MOST_COORDINATE
from ecat.store import staged_file
from learn.features import ch4
from learn.features.ch5 import interpolated
from learn.features.points import JOINTS
from learn.features.recordings import Recording
from learn.features.windows import Table, fit_table

Floats = NDArray[np.float64]
_VERSION = 1
_HEAD = b'{\n "transform"'
_MOST_BYTES = 1 << 20


class Transform(Protocol):
    """What is fitted to recordings and applied to others."""

    kind: ClassVar[str]

    @classmethod
    def fit(cls, recordings: Sequence[Recording]) -> Self:
        """The transform that suits these recordings."""
        ...

    def apply(self, recording: Recording) -> Floats:
        """What becomes of a recording."""
        ...

    def numbers(self) -> dict[str, Any]:
        """What was fitted, as JSON."""
        ...

    @classmethod
    def of(cls, numbers: dict[str, Any]) -> Self:
        """The transform of these :meth:`numbers`."""
        ...


@dataclass(frozen=True)
class PcaPlanes:
    """The planes in which points vary most (thesis chapter 4; :func:`learn.features.ch4.fit_projections`)."""

    projections: ch4.Projections
    kind: ClassVar[str] = "pca"

    @classmethod
    def fit(cls, recordings: Sequence[Recording]) -> Self:
        """Planes of all points of the recordings, and of the corners of their boxes.

        Raises
        ------
        InputError : fewer than three points are known.
        """
        points = [recording.points for recording in recordings]
        return cls(ch4.fit_projections(np.concatenate(points) if points else np.empty((0, 21, 3))))

    def apply(self, recording: Recording) -> Floats:
        """The nine places (n, 18) of :func:`learn.features.ch4.pcas`."""
        return ch4.pcas(recording.points, self.projections)

    def numbers(self) -> dict[str, Any]:
        """Means and components."""
        planes = {"inter": self.projections.inter, "intra": self.projections.intra}
        return {
            name: {"mean": plane.mean.tolist(), "components": plane.components.tolist()}
            for name, plane in planes.items()
        }

    @classmethod
    def of(cls, numbers: dict[str, Any]) -> Self:
        """The planes of these numbers."""
        planes = [
            ch4.Projection(_array(numbers[name]["mean"], 3), _array(numbers[name]["components"], 2, 3))
            for name in ("inter", "intra")
        ]
        return cls(ch4.Projections(*planes))


@dataclass(frozen=True)
class TablePlane:
    """The plane of the markers on a table that is level from side to side, in the Kinect's camera space."""

    table: Table
    kind: ClassVar[str] = "table"

    @classmethod
    def fit(cls, recordings: Sequence[Recording]) -> Self:
        """The plane under the markers of the recordings.

        Raises
        ------
        InputError : fewer than three corners are known.
        """
        points = [recording.points for recording in recordings]
        return cls(fit_table(np.concatenate(points) if points else np.empty((0, 21, 3))))

    def apply(self, recording: Recording) -> Floats:
        """Where both boxes are on the table: (2, n, 3) x, y away from the camera, and rotation below a quarter turn.

        A box is where the rays through the corners of its marker meet the plane, on average; gaps are interpolated.

        Raises
        ------
        InputError : a box was never seen.
        """
        corners = recording.points[:, len(JOINTS) :].reshape(-1, 2, 4, 3)
        slope, height = self.table.slope, self.table.height
        with np.errstate(divide="ignore", invalid="ignore"):
            right, up = corners[..., 0] / corners[..., 2], corners[..., 1] / corners[..., 2]
            far = height / (up - slope)
        far = np.where(np.isfinite(far) & (far > 0), far, np.nan)
        place = np.stack([right * far, far * (slope * up + 1) / np.hypot(1.0, slope)], axis=-1)
        middle, edge = place.mean(axis=2), place[:, :, 1] - place[:, :, 0]
        turned = np.arctan2(edge[..., 1], edge[..., 0]) % (np.pi / 2) % (np.pi / 2)
        tracks = np.concatenate([middle, turned[..., None]], axis=-1)
        return np.stack([interpolated(tracks[:, box]) for box in range(2)])

    def numbers(self) -> dict[str, Any]:
        """Slope and height."""
        return asdict(self.table)

    @classmethod
    def of(cls, numbers: dict[str, Any]) -> Self:
        """The plane of these numbers."""
        slope, height = _array([numbers["slope"], numbers["height"]], 2).tolist()
        return cls(Table(slope, height))


KINDS: dict[str, type[PcaPlanes] | type[TablePlane]] = {one.kind: one for one in (PcaPlanes, TablePlane)}


def save_transform(transform: Transform, path: Path) -> None:
    """Write a transform as JSON, in place of one that is there.

    Raises
    ------
    ExistsError : something else is there.
    """
    document = {"transform": transform.kind, "version": _VERSION, **transform.numbers()}
    with staged_file(path, replaces=_HEAD) as staging:
        staging.write_text(json.dumps(document, indent=1) + "\n", "utf-8")


def load_transform(path: Path, kind: str) -> PcaPlanes | TablePlane:
    """The transform in a file, which must be of this kind.

    Raises
    ------
    NotFoundError : there is none.
    FormatError : it is no transform.
    InputError : it is of another kind.
    """
    what = f"cannot use the transform {path}"
    if not path.is_file():
        raise NotFoundError(what, where="there is no such file", fix="fit one with --fit")
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError("it is too large")  # noqa: TRY301 - one error for all that it cannot be
        document = json.loads(path.read_bytes())
        found, version = document["transform"], document["version"]
        made = KINDS[found].of(document) if version == _VERSION and found in KINDS else None
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError) as error:
        raise FormatError(
            what, where=f"it is not what --fit writes ({type(error).__name__}: {error})"
        ) from None
    if made is None or made.kind != kind:
        raise InputError(
            what,
            where=f"it is the transform {found!r} of version {version!r}, wanted is {kind!r} of version {_VERSION}",
            consequence="nothing was computed",
            fix="fit one with --fit",
        )
    return made


def _array(values: Any, *shape: int) -> Floats:
    found = np.array(values, np.float64).reshape(shape)
    if not (np.abs(found) <= MOST_COORDINATE).all():
        raise ValueError("a number is not finite, or absurdly large")
    return found
