"""Curves over time: how fast boxes are, how far from each other and from hands; computed when asked for."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ecat.errors import NotFoundError
from ecat.geometry.transforms import Floats
from ecat.process.inputs import clock_table
from ecat.stages.tracks import HandTrack, Timeline, Track, read_hands, read_tracks, timeline
from ecat.store import Session
from ecat.web.binary import Array
from ecat.web.scene import boxes_of

HALF_WINDOW = 3
"""Speeds are over the three frames before and after, as those that tell what moves together."""
MOST_PAIRED = 12
"""Of more boxes than this, the distances are not offered: there would be hundreds."""
_HANDS = {"HandLeft": "left hand", "HandRight": "right hand"}


@dataclass(frozen=True)
class Series:
    """A curve: ``values`` gives a number (n,) for every frame, NaN where it is not known."""

    name: str
    title: str
    unit: str
    values: Callable[[], Floats]

    def to_dict(self) -> dict[str, str]:
        """What it is, without its values."""
        return {"name": self.name, "title": self.title, "unit": self.unit}


class Curves:
    """All curves of a session as it is now."""

    def __init__(self, session: Session) -> None:
        self._line: Timeline | None = None
        self._series: dict[str, Series] = {}
        poses = next((name for name in ("poses_smooth", "poses") if session.has_table(name)), None)
        if poses is None:
            return
        self._line = timeline(clock_table(session))
        names = _object_names(session)
        tracks = read_tracks(session.table(poses).to_arrow(), boxes_of(session), self._line)
        hands = self._hands(session, self._line)
        timed = None not in self._line.t_ns
        for track in tracks if timed else ():
            self._add(
                f"speed {track.object_id}",
                f"speed of {names(track.object_id)}",
                "m/s",
                _speed(track, self._line),
            )
        near = tracks if len(tracks) <= MOST_PAIRED else []
        for a, b in combinations(near, 2):
            title = f"{names(a.object_id)} to {names(b.object_id)}"
            self._add(f"distance {a.object_id} {b.object_id}", title, "m", _gap(a, b))
        for hand in hands:
            for track in near:
                title = f"{_HANDS[hand.joint]} to {names(track.object_id)}"
                self._add(f"hand {hand.target} {track.object_id}", title, "m", _reach(hand, track))

    @staticmethod
    def _hands(session: Session, line: Timeline) -> list[HandTrack]:
        if not (session.has_table("joints") and session.has_table("table_plane")):
            return []
        joints = session.table("joints").to_arrow()
        return read_hands(joints, session.table("table_plane").to_arrow(), line, tuple(_HANDS))

    def _add(self, key: str, title: str, unit: str, values: Callable[[], Floats]) -> None:
        name = base = re.sub(r"[^A-Za-z0-9_.-]+", "-", key)
        n = 1
        while name in self._series:
            n += 1
            name = f"{base}-{n}"
        self._series[name] = Series(name, title, unit, values)

    def describe(self) -> list[dict[str, str]]:
        """Every curve, without its values."""
        return [series.to_dict() for series in self._series.values()]

    def columns(self, name: str) -> dict[str, Array]:
        """``frame`` and ``value`` of the curve called ``name``, where it is known.

        Raises
        ------
        NotFoundError : there is no such curve.
        """
        series = self._series.get(name)
        if series is None or self._line is None:
            known = ", ".join(list(self._series)[:10]) or "none"
            raise NotFoundError(
                f"cannot find series {name[:80]}", where=f"there are: {known}", fix="name one of them"
            )
        values = series.values()
        there = np.isfinite(values)
        return {
            "frame": self._line.frame[there].astype(np.int32),
            "value": values[there].astype(np.float32),
        }


def _speed(track: Track, line: Timeline) -> Callable[[], Floats]:
    def values() -> Floats:
        n = len(line.t_s)
        before = np.maximum(np.arange(n) - HALF_WINDOW, 0)
        after = np.minimum(np.arange(n) + HALF_WINDOW, n - 1)
        span = np.maximum(line.t_s[after] - line.t_s[before], 1e-9)
        place = track.pose.translation
        return np.linalg.norm(place[after] - place[before], axis=1) / span

    return values


def _gap(a: Track, b: Track) -> Callable[[], Floats]:
    def values() -> Floats:
        from ecat.geometry.relations import Rigid, box_gap

        known = np.flatnonzero(np.isfinite(a.pose.translation[:, 0] + b.pose.translation[:, 0]))
        one, other = (Rigid(t.pose.rotation[known], t.pose.translation[known]) for t in (a, b))
        out = np.full(len(a.sigma_m), np.nan)
        out[known] = box_gap(one, other, a.size_m, b.size_m)
        return out

    return values


def _reach(hand: HandTrack, track: Track) -> Callable[[], Floats]:
    def values() -> Floats:
        from ecat.geometry.relations import point_gap

        return point_gap(hand.place, track.pose, track.size_m)

    return values


def _object_names(session: Session) -> Callable[[str], str]:
    """The name that somebody gave to an object, or its id."""
    rows = (
        session.table("objects", columns=("object_id", "name")).to_arrow()
        if session.has_table("objects")
        else None
    )
    named = rows.to_pylist() if rows is not None else []
    names = {row["object_id"]: row["name"] for row in reversed(named) if row["name"]}
    return lambda object_id: names.get(object_id, object_id)
