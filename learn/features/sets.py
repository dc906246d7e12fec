"""Sets of features by name: what each consists of, where it comes from, and what it takes.

A set is computed from any recording (:mod:`learn.features.recordings`) and its columns are the same for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from learn.features import ch4, ch5, windows
from learn.features.points import JOINTS, N_POINTS
from learn.features.recordings import Recording
from learn.features.transforms import PcaPlanes, TablePlane

Floats = NDArray[np.float64]
Fitted = PcaPlanes | TablePlane | None


@dataclass(frozen=True, kw_only=True)
class FeatureSet:
    """A set of features.

    Attributes
    ----------
    name, source : what it is called, also by models that see it, and where it is described.
    what, named : what it is, and how its columns are to be read.
    columns : names of its columns.
    compute : of a recording and a transform, its rows (n, columns).
    per : what a row is of; of windows of 20 frames, every 5 frames.
    inputs : what it is made of; ``joints`` are needed as well where it says so.
    transform : the kind of transform (:data:`learn.features.transforms.KINDS`) that it takes; empty if none.
    always : whether it takes one of every recording; otherwise only of those that do not say where the table is.
    """

    name: str
    source: str
    what: str
    named: str
    columns: Callable[[], tuple[str, ...]]
    compute: Callable[[Recording, Fitted], NDArray[Any]]
    per: Literal["frame", "window"] = "frame"
    inputs: Literal["joints and markers", "tracks", "markers, joints"] = "tracks"
    transform: Literal["", "pca", "table"] = ""
    always: bool = False


def feature_set(name: str) -> FeatureSet:
    """The set of this name.

    Raises
    ------
    UsageError : there is none.
    """
    if name not in SETS:
        known = ", ".join(SETS)
        raise UsageError(
            f"cannot compute the features {name}", where=f"there are {known}", fix="choose one of these"
        )
    return SETS[name]


def features(
    recording: Recording, wanted: FeatureSet, transform: Fitted = None, *, every: int = 1
) -> pa.Table:
    """The features of a recording: columns ``session``, ``frame`` (of windows, the first), and those of the set.

    What is not known is null where a feature is a measurement; where it is a code it is refused.

    Parameters
    ----------
    every : of how many frames one is kept; only for sets of chapter 5 (:func:`learn.features.ch5.quotient`).

    Raises
    ------
    InputError : the recording lacks what the set is made of, or is too short.
    UsageError : a transform is needed, or ``every`` has no meaning for the set.
    """
    if wanted.inputs == "joints and markers" and not recording.has_joints:
        raise _unfit(
            recording, wanted, "there are no joints", "import the skeleton with the session (ecat file add)"
        )
    if wanted.transform and transform is None and (wanted.always or _has_no_table(recording)):
        raise UsageError(
            f"cannot compute {wanted.name} of {recording.name}",
            where=f"it needs the transform {wanted.transform!r}, fitted to the recordings that models are trained on",
            fix="--fit FILE with the training recordings, then --transform FILE with others",
        )
    if every != 1 and wanted.inputs != "tracks":
        raise UsageError(
            f"cannot leave out frames of {wanted.name}",
            where="only features of chapter 5 are of every so many frames",
            fix="leave --every out",
        )
    if wanted.per == "window" and len(recording.points) < windows.LENGTH:
        where = f"it has {len(recording.points)} frames, a window {windows.LENGTH}"
        raise _unfit(recording, wanted, where, "leave the session out")
    if wanted.inputs == "tracks":
        values = wanted.compute(_sampled(recording, wanted, transform, every), None)
    else:
        values = wanted.compute(recording, transform)
    step = windows.HOP if wanted.per == "window" else every
    columns = [pa.array(column, from_pandas=True) for column in values.T]
    frame = pa.array(step * np.arange(len(values), dtype=np.int32), pa.int32())
    named = pa.repeat(pa.scalar(recording.name), len(values))
    return pa.table([named, frame, *columns], names=["session", "frame", *wanted.columns()])


def schema_of(wanted: FeatureSet, table: pa.Table) -> dict[str, str]:
    """What a file of features says about them: set, source, what they are, what a row is of."""
    return {
        "ecat:features": wanted.name,
        "ecat:what": wanted.what,
        "ecat:named": wanted.named,
        "ecat:source": wanted.source,
        "ecat:row": wanted.per,
        "ecat:columns": str(table.num_columns - 2),
    }


def _has_no_table(recording: Recording) -> bool:
    return recording.tracks is None and not recording.planes


def _sampled(recording: Recording, wanted: FeatureSet, transform: Fitted, every: int) -> Recording:
    tracks = recording.tracks
    if tracks is None and isinstance(transform, TablePlane):
        tracks = transform.apply(recording)
    if tracks is None:
        where = "it is not known where the boxes are on the table"
        raise _unfit(recording, wanted, where, "ecat process the session, or --fit a table")
    sampled = np.stack([ch5.subsampled(track, every) for track in tracks])
    if not sampled.shape[1]:
        raise _unfit(recording, wanted, f"it has {tracks.shape[1]} frames", f"--every less than {every}")
    return Recording(recording.name, recording.points, sampled, None, recording.objects)


def _unfit(recording: Recording, wanted: FeatureSet, where: str, fix: str) -> InputError:
    return InputError(
        f"cannot compute {wanted.name} of {recording.name}",
        where=where,
        consequence="nothing was computed of it",
        fix=fix,
    )


# --- the sets


def _ranked(recording: Recording) -> tuple[Floats, Floats]:
    assert recording.tracks is not None  # made sure before
    return ch5.by_salience(recording.tracks)


def _places(recording: Recording, transform: Fitted) -> Floats:
    assert isinstance(transform, PcaPlanes)  # made sure before
    return transform.apply(recording)


def _qsr(recording: Recording, transform: Fitted) -> ch4.Small:
    return ch4.qsr25(_places(recording, transform))


def _event(recording: Recording, transform: Fitted) -> NDArray[Any]:
    rows = _qsr(recording, transform)
    starts = windows.HOP * np.arange(windows.n_windows(len(rows)))
    return ch4.event75(rows[starts[:, None] + np.arange(windows.LENGTH)])


def _windows(recording: Recording, transform: Fitted) -> NDArray[Any]:
    table = transform.table if isinstance(transform, TablePlane) else None
    parts = recording.leveled()
    if table is None and (len(parts) != 1 or parts[0][2] is None):
        where = (
            f"the table was fitted {len(parts)} times, and windows see one"
            if len(parts) > 1
            else "no table is known"
        )
        raise _unfit(
            recording,
            SETS[windows.VERSION],
            where,
            "--transform FILE with a table fitted to other recordings",
        )
    points, table = (recording.points, table) if table is not None else parts[0][1:]
    assert table is not None
    return windows.window_features(windows.windows_of(points), table)


def _raw_columns() -> tuple[str, ...]:
    corners = (f"o{box}_corner{corner}" for box in (1, 2) for corner in range(1, 5))
    return tuple(f"{name}_{axis}" for name in (*JOINTS, *corners) for axis in "xyz")


@cache
def _window_columns() -> tuple[str, ...]:
    one = np.zeros((1, windows.LENGTH, N_POINTS, 3))
    count = windows.window_features(one, windows.Table(0.0, -1.0)).shape[1]
    return tuple(f"w{number:03}" for number in range(count))


def _fixed(columns: Sequence[str]) -> Callable[[], tuple[str, ...]]:
    return lambda: tuple(columns)


_CH4, _CH5 = "thesis chapter 4", "thesis chapter 5"
_PAIRS = ", ".join(f"{number} {ch4.PLACES[a]} and {ch4.PLACES[b]}" for number, (a, b) in enumerate(ch4.PAIRS))
_QSR = (
    f"*_diff_K: change from the frame before of the code of the direction (cardir) or the distance (argd) of pair K: "
    f"{_PAIRS}; mos_*: 1 if it moved; qtc_*: signs of QTC of the boxes, -1 for towards"
)
_BLOCKS = (
    "first is the block that moves, anew for each five frames; *_change to the next frame, 0 at the last"
)
_CODES = (
    "codes, 0 at the first frame where they are of a change; -1 of QTC is towards; rotations in eighths of pi"
)
_ALL = (
    FeatureSet(
        name="ch4-raw",
        source=_CH4,
        what="places of joints and of markers' corners",
        named="metres in the Kinect's camera space; o1_corner1 to o2_corner4 are corners of a marker of either box",
        columns=_raw_columns,
        compute=lambda recording, _: recording.points.reshape(-1, 3 * N_POINTS),
        inputs="joints and markers",
    ),
    FeatureSet(
        name="ch4-pcas18",
        source=_CH4,
        what="nine places in the planes of most variance",
        named="metres in the plane; body is the shoulders' middle, hands are their finger tips",
        columns=_fixed(ch4.PCAS_COLUMNS),
        compute=_places,
        inputs="joints and markers",
        transform="pca",
        always=True,
    ),
    FeatureSet(
        name="ch4-qsr25",
        source=_CH4,
        what="changes of directions and distances of nine pairs, what moved, QTC of the boxes",
        named=_QSR,
        columns=_fixed(ch4.QSR_COLUMNS),
        compute=_qsr,
        inputs="joints and markers",
        transform="pca",
        always=True,
    ),
    FeatureSet(
        name="ch4-sparse522",
        source=_CH4,
        what="ch4-qsr25, one-hot",
        named="NAME=V: 1 where the column NAME of ch4-qsr25 has the value V",
        columns=_fixed(ch4.SPARSE_COLUMNS),
        compute=lambda recording, transform: ch4.sparse522(_qsr(recording, transform)),
        inputs="joints and markers",
        transform="pca",
        always=True,
    ),
    FeatureSet(
        name="ch4-event75",
        source=_CH4,
        what="ch4-qsr25 of the first frame, the last, and their difference",
        named="first_, last_, last_minus_first_, then a column of ch4-qsr25",
        columns=_fixed(ch4.EVENT_COLUMNS),
        compute=_event,
        per="window",
        inputs="joints and markers",
        transform="pca",
        always=True,
    ),
    FeatureSet(
        name="ch5-transforms",
        source="thesis 2.2.1",
        what="transforms of both blocks, their difference, their changes",
        named=f"metres and radians; {_BLOCKS}",
        columns=_fixed(ch5.TRANSFORM_COLUMNS),
        compute=lambda recording, _: ch5.transforms(*_ranked(recording)),
        transform="table",
    ),
    FeatureSet(
        name="ch5-quantitative",
        source=_CH5,
        what="corners of both blocks, their changes, their difference",
        named=f"metres on the table; {_BLOCKS}",
        columns=_fixed(ch5.QUANTITATIVE_COLUMNS),
        compute=lambda recording, _: ch5.quantitative(*_ranked(recording)),
        transform="table",
    ),
    FeatureSet(
        name="ch5-qualitative",
        source="thesis 2.2.2",
        what="F1 to F13: direction, distance, movement, rotations, and changes of these",
        named=f"{_CODES}; columns are in the order F1 to F13",
        columns=_fixed(ch5.QUALITATIVE_COLUMNS),
        compute=lambda recording, _: ch5.qualitative(*_ranked(recording)),
        transform="table",
    ),
    FeatureSet(
        name="ch5-network",
        source=_CH5,
        what="what the progress networks saw",
        named=f"{_CODES}; a turn by seven sectors is one the other way",
        columns=_fixed(ch5.NETWORK_COLUMNS),
        compute=lambda recording, _: ch5.network_input(ch5.qualitative(*_ranked(recording))),
        transform="table",
    ),
    FeatureSet(
        name="ch5-network-8",
        source=_CH5,
        what="the same with the distance, for SlideNext",
        named="argd: the distance in steps of half a block; then the columns of ch5-network",
        columns=_fixed(ch5.NETWORK8_COLUMNS),
        compute=lambda recording, _: ch5.network_input(ch5.qualitative(*_ranked(recording)), distance=True),
        transform="table",
    ),
    FeatureSet(
        name=windows.VERSION,
        source="ecat",
        what="what the trees of ecat's recogniser see",
        named="numbered in the order in which learn.features.windows computes them",
        columns=_window_columns,
        compute=_windows,
        per="window",
        inputs="markers, joints",
        transform="table",
    ),
)
SETS = {one.name: one for one in _ALL}
"""All sets by name."""
