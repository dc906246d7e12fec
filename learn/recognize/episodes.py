"""A whole session as recordings of one action each: the stretches in which boxes move.

A recogniser knows recordings of one action, as long as the sessions that it was trained on.  A longer session is cut
into stretches around the movements of its boxes, and each of them is recognised as a recording of its own.  No window
goes over a jump of the clock, or hardly shows one of the boxes: it would be no evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ecat.cli.text import count
from ecat.errors import InputError
from ecat.process.inputs import MAX_FRAMES
from learn.features.ch5 import interpolated
from learn.features.points import JOINTS, N_POINTS
from learn.features.recordings import Recording
from learn.features.windows import HOP, LENGTH, Table

Floats = NDArray[np.float64]

FPS = 30.0
"""Frames per second of what recognisers are trained on, as the Kinect delivers them."""
USUAL_FPS = (22.0, 33.0)
"""Between these nothing is resampled: the exports' own rate is somewhere from 24 to 30."""
SLOWEST_FPS = 8.0
"""With fewer frames per second it is not known how hands and boxes move."""
ONE_ACTION = 150
"""Frames up to which a session is taken to show one action; the exports of ECAT have up to 139."""
MARGIN = LENGTH // 2
"""Frames before and after a movement, so that its first window is about its beginning."""
_GAP_S = 0.2
"""Points are interpolated over gaps up to this long when a session is resampled."""
_JUMP_S = LENGTH / 2 / FPS
"""Where the clock goes on by more than this and a frame, it jumps: half a window is not there."""
MOST_UNSEEN = LENGTH * 3 // 4
"""Frames of a window in which a box may be unseen; hands are often before it for half of one, which does not matter."""
_STEP, _MOVED_M, _PAUSE = 10, 0.02, 15
"""A box moves where it gets this far in so many frames about it; shorter pauses do not part movements."""


@dataclass(frozen=True)
class Episode:
    """Points (n, 21, 3) of one action, at about :data:`FPS`; ``frame`` (n + 1,) where each is in the session, and the
    end; ``table`` the one of the session, None if it is not known; ``goes_on`` if it shows the movement of the one
    before, and not more than a window is left out between them.
    """

    points: Floats
    frame: Floats
    table: Table | None
    goes_on: bool = False

    def places(self, tracks: Floats) -> Floats:
        """Where boxes are on the table (2, n, 2), by tracks (2, m, 3) of the session at the nearest frames."""
        frames = self.frame[:-1].round().astype(np.int64).clip(0, tracks.shape[1] - 1)
        return tracks[:, frames, :2]


def episodes(recording: Recording, findings: list[str] | None = None) -> list[Episode]:
    """The stretches of a recording that show an action each, or more of the one before, in their order.

    Parameters
    ----------
    findings : gets lines about what was left out, and why.

    Raises
    ------
    InputError : it is shorter than a window, or has too few frames per second.
    """
    whole = _stretches(recording)
    longest = max((len(one.points) for one in whole), default=0)
    if longest < LENGTH:
        where = f"it has {len(recording.points)} frames, a window {LENGTH}"
        if len(whole) > 1:
            where += f", and at most {longest} follow each other with one table and no jump of the clock"
        elif recording.t_s is not None and len(recording.points) >= LENGTH:
            where += f"; {_span(recording.t_s)}, they are {longest} at {FPS:g} per second"
        raise _unfit(recording, where, "give a longer session, or correct its times")
    shown = [_shown(one) for one in whole]
    if findings is not None:
        findings += _left_out(recording, zip(whole, shown, strict=True))
    found: list[Episode] = []
    for one, parts in zip(whole, shown, strict=True):
        n = len(one.points)
        moves = [(0, n)] if len(whole) == 1 and n <= ONE_ACTION else _movements(recording, one)
        for start, end in moves:
            seen = ((max(start, first), min(end, stop)) for first, stop in parts)
            found += _parts(one, [span for span in seen if span[1] - span[0] >= LENGTH])
    return found


def _parts(one: Episode, spans: Sequence[tuple[int, int]]) -> list[Episode]:
    """Of a movement, what is shown of it."""
    goes_on = [False, *(then - end <= LENGTH for (_, end), (then, _) in pairwise(spans))]
    return [
        Episode(one.points[start:end], one.frame[start : end + 1], one.table, more)
        for (start, end), more in zip(spans, goes_on, strict=False)
    ]


def _stretches(recording: Recording) -> list[Episode]:
    """What is of one table and without a jump of the clock, each with as many frames per second as is usual."""
    step = _step(recording)
    found: list[Episode] = []
    for begin, points, table in recording.leveled():
        edges = [
            0,
            *(at - begin for at in _jumps(recording, step) if 0 < at - begin < len(points)),
            len(points),
        ]
        found += [
            _at_usual_rate(recording, begin + start, points[start:end], table, step)
            for start, end in pairwise(edges)
        ]
    return found


def _step(recording: Recording) -> float:
    """Seconds from one frame to the next; as is usual where there is no clock.

    Raises
    ------
    InputError : there are too few frames per second.
    """
    t_s = recording.t_s
    if t_s is None or len(t_s) < 2:
        return 1 / FPS
    step = float(np.median(np.diff(t_s)))
    if 1 / step < SLOWEST_FPS:
        where = f"it has {1 / step:.1f} frames per second, at least {SLOWEST_FPS:g} are needed"
        raise _unfit(recording, where, "record more images per second")
    return step


def _jumps(recording: Recording, step: float) -> list[int]:
    """Frames before which the clock jumps."""
    if recording.t_s is None:
        return []
    return (np.flatnonzero(np.diff(recording.t_s) > _JUMP_S + step) + 1).tolist()


def _at_usual_rate(
    recording: Recording, start: int, points: Floats, table: Table | None, step: float
) -> Episode:
    """The stretch of a session that begins at frame ``start``, with as many frames per second as is usual."""
    frame = np.arange(start, start + len(points) + 1, dtype=np.float64)
    t_s = None if recording.t_s is None else recording.t_s[start : start + len(points)]
    if t_s is None or len(t_s) < 2 or USUAL_FPS[0] <= 1 / step <= USUAL_FPS[1]:
        return Episode(points, frame, table)
    if (t_s[-1] - t_s[0]) * FPS > MAX_FRAMES:
        where = f"it has {1 / step:.1f} frames per second, {_span(t_s)}: at {FPS:g}, more than {MAX_FRAMES:,}"
        raise _unfit(recording, where, "correct its times, or split a longer recording")
    times = np.arange(t_s[0], t_s[-1] + step / 2, 1 / FPS)
    places = np.append(np.interp(times, t_s, frame[:-1]), frame[-1])
    return Episode(_resampled(points, t_s, times), places, table)


def _unseen(one: Episode) -> NDArray[np.bool_]:
    """Whether each box (2, n) is not seen in a frame: no corner of it is known."""
    known = np.isfinite(one.points[:, len(JOINTS) :]).all(axis=2).reshape(-1, 2, 4)
    return np.logical_not(known.any(axis=2)).T


def _shown(one: Episode) -> list[tuple[int, int]]:
    """Frames, from first to before the last, of windows in which each box is seen for a quarter at least."""
    if len(one.points) < LENGTH:
        return []
    before = np.pad(np.cumsum(_unseen(one), axis=1), ((0, 0), (1, 0)))
    good = (before[:, LENGTH:] - before[:, :-LENGTH]).max(axis=0) <= MOST_UNSEEN
    runs = [*_runs(good), (len(one.points) + HOP, 0)]
    # what is said of the last window of one run ends before what is said of the first of the next begins
    apart = ((start, min(end, then - HOP)) for (start, end), (then, _) in pairwise(runs))
    return [(start, end - 1 + LENGTH) for start, end in apart if start < end]


def _left_out(recording: Recording, stretches: Iterable[tuple[Episode, list[tuple[int, int]]]]) -> list[str]:
    """What is not recognised since a box is not seen or the clock jumps: how much of it there is, and where."""
    step = _step(recording)
    spans: list[tuple[float, float]] = []
    unseen = np.zeros(2)
    for one, shown in stretches:
        out = np.ones(len(one.points), bool)
        for start, end in shown:
            out[start:end] = False
        lost = _unseen(one) & out
        if lost.any():  # otherwise it is too short
            spans += [(float(one.frame[start]), float(one.frame[end])) for start, end in _runs(out)]
            unseen += (np.diff(one.frame) * lost).sum(axis=1)
    said = [_clock_said(recording.t_s, jumps, step)] if (jumps := _jumps(recording, step)) else []
    lasting = [end - start for start, end in spans]
    if round(sum(lasting) * step * FPS) >= LENGTH:  # less than a window is not worth a line
        first, last = spans[int(np.argmax(lasting))]
        boxes = [
            f"{recording.called.get(name, name)} is not seen for {frames * step:.1f} s of it"
            for name, frames in zip(recording.objects, unseen.tolist(), strict=True)
            if frames * step >= 0.05
        ]
        longest = f"frames {first:,.0f} to {last:,.0f}{' and less' * (len(spans) > 1)}"
        said.append(
            f"left out {sum(lasting) * step:.1f} s ({longest}), in which windows show a box less than a quarter of "
            f"the time: {', '.join(boxes)}"
        )
    return said


def _clock_said(t_s: Floats | None, jumps: Sequence[int], step: float) -> str:
    assert t_s is not None  # otherwise nothing jumps
    lost = sum(float(t_s[at] - t_s[at - 1]) - step for at in jumps)
    return (
        f"the clock jumps {count(len(jumps), 'time')}, by {lost:,.1f} s in all, first at frame {jumps[0]:,}: what "
        "is before and after is recognised apart"
    )


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where it is true: first place, and the one after the last."""
    edges = np.flatnonzero(np.diff(np.r_[0, mask, 0])).reshape(-1, 2)
    return [(start, end) for start, end in edges.tolist()]


def _span(t_s: Floats) -> str:
    return f"from {t_s[0]:.6g} to {t_s[-1]:.6g} s"


def _unfit(recording: Recording, where: str, fix: str) -> InputError:
    what = f"cannot recognise actions of session {recording.name}"
    return InputError(what, where=where, consequence="nothing was recognised", fix=fix)


def _resampled(points: Floats, t_s: Floats, times: Floats) -> Floats:
    """Points (n, 21, 3) at other times, interpolated between what is known, but over no long gap."""
    found = np.full((len(times), N_POINTS, 3), np.nan)
    for point in range(N_POINTS):
        known = np.isfinite(points[:, point]).all(axis=1)
        if not known.any():
            continue
        its = t_s[known]
        after = np.searchsorted(its, times).clip(0, len(its) - 1)
        before = np.searchsorted(its, times, side="right").clip(1) - 1
        near = np.minimum(np.abs(its[after] - times), np.abs(times - its[before])) <= _GAP_S / 2
        for axis in range(3):
            found[near, point, axis] = np.interp(times[near], its, points[known, point, axis])
    return found


def _movements(recording: Recording, one: Episode) -> list[tuple[int, int]]:
    """Where a box moves, with a margin: by the relations of the session, else by its poses, else by its markers."""
    n = len(one.points)
    if recording.moves is None:
        found = _seen_to_move(recording, one)
    else:
        places = np.searchsorted(one.frame, np.array(recording.moves, np.float64).reshape(-1, 2))
        found = [(start, end) for start, end in places.clip(0, n).tolist() if end > start]
        found = _joined(found, lambda a, b: 2 * (a[1] - b[0]) > min(a[1] - a[0], b[1] - b[0]))
    wide = [(max(0, min(start - MARGIN, n - LENGTH)), end + MARGIN) for start, end in found]
    return [(start, min(n, max(end, start + LENGTH))) for start, end in wide]


def _seen_to_move(recording: Recording, one: Episode) -> list[tuple[int, int]]:
    n = len(one.points)
    moving = np.zeros(n, bool)
    for box in range(2):
        at = len(JOINTS) + 4 * box
        if recording.tracks is not None:
            place = one.places(recording.tracks)[box]
        else:
            place = np.median(one.points[:, at : at + 4], axis=1)
            if not np.isfinite(place).all(axis=1).any():
                continue
            place = _calm(interpolated(place))
        moved = np.linalg.norm(place[_STEP:] - place[:-_STEP], axis=1) > _MOVED_M
        moving[_STEP // 2 : _STEP // 2 + len(moved)] |= moved
    return _joined(_runs(moving), lambda a, b: b[0] - a[1] < _PAUSE)


def _joined(
    spans: Sequence[tuple[int, int]], belong: Callable[[tuple[int, int], tuple[int, int]], bool]
) -> list[tuple[int, int]]:
    """Spans in their order, each joined with the one before if they belong together."""
    found: list[tuple[int, int]] = []
    for span in spans:
        if found and belong(found[-1], span):
            found[-1] = found[-1][0], max(found[-1][1], span[1])
        else:
            found.append(span)
    return found


def _calm(place: Floats) -> Floats:
    """Medians of nine frames: the depth of a marker jumps now and then."""
    padded = np.pad(place, ((4, 4), (0, 0)), mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 9, axis=0), axis=-1)
