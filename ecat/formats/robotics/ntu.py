"""Skeletons of NTU RGB+D (``.skeleton``), both ways; the reader is :mod:`ecat.formats.recordings.ntu`.

Carried: 25 joints of every body at every frame, in Kinect camera space, in the depth and in the colour image, and
whether each was tracked.  Left behind: the clock, whose body it is, joints of other names, and everything but bodies.
What the format asks for and a session does not know: orientations (0 0 0 0, as the Kinect says "none"), hands and lean
(0).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ecat.errors import NotFoundError
from ecat.formats.options import NoOptions
from ecat.formats.recordings import ntu
from ecat.formats.robotics import tracks
from ecat.formats.robotics.scene import stream_camera
from ecat.formats.robotics.tracks import JOINTS, NOT_TRACKED, Bodies
from ecat.geometry.cameras import Camera
from ecat.progress import Progress
from ecat.store import Session

_BODY = "{slot} 0 0 0 0 0 0 0 0 2\n"
"""Identifier, clipped edges, confidence and state of both hands, restricted, lean x and y, tracking state (tracked)."""


def part(session: Session, label: str, dest: Path, options: NoOptions, progress: Progress) -> tuple[str, ...]:
    """Write the bodies of a session.

    Raises
    ------
    NotFoundError : there are none, or none with joints of these names.
    """
    del options
    names = tracks.joint_names(session)
    if not names & set(JOINTS):
        raise NotFoundError(
            f"cannot write the skeletons of {label}",
            where=f"{session.name}: there is no body with a Kinect's joints",
            consequence="this session was not written",
            fix=f"ecat info {session.path} tells what was recorded",
        )
    slots = tracks.body_slots(session)
    n_frames = max(session.manifest.n_frames, 1 + _last_frame(session))
    camera = _depth_camera(session)
    with tracks.new_text(dest) as out:
        out.write(f"{n_frames}\n")
        next_frame = unknown = 0
        for stretch in tracks.bodies(session, list(slots)):
            unknown += int((stretch.state[stretch.seen] < 0).sum())
            for f, frame in enumerate(stretch.frame.tolist()):
                out.write("0\n" * (frame - next_frame))
                next_frame = frame + 1
                out.writelines(frame_lines(stretch, f, list(slots), camera))
            progress(f"writing {label}", next_frame, n_frames)
        out.write("0\n" * (n_frames - next_frame))
    return tuple(_findings(session, names, slots, unknown, camera))


def _last_frame(session: Session) -> int:
    return max(int(np.asarray(rows["frame"])[-1]) for rows in tracks.stretches(session, "joints", ("frame",)))


def _depth_camera(session: Session) -> Camera | None:
    for stream in session.manifest.streams:
        if stream.kind == "depth":
            return stream_camera(session.manifest, stream)
    return None


def frame_lines(stretch: Bodies, f: int, slots: list[int], camera: Camera | None) -> Iterator[str]:
    """The lines of the frame at row ``f``: how many bodies, and each that is seen."""
    there = np.flatnonzero(stretch.seen[f])
    yield f"{len(there)}\n"
    for b in there:
        yield _BODY.format(slot=slots[b]) + f"{len(JOINTS)}\n"
        points = stretch.position[f, b]
        place = camera.project(points) if camera is not None else np.full((len(JOINTS), 2), np.nan)
        kinect = points * [-1.0, -1.0, 1.0]
        state = np.maximum(stretch.state[f, b], NOT_TRACKED)
        rows = np.hstack([kinect, place, stretch.pixel[f, b]]).tolist()
        for row, tracked in zip(rows, state.tolist(), strict=True):
            yield f"{' '.join(map(repr, row))} 0 0 0 0 {tracked}\n"


def _findings(
    session: Session, names: set[str], slots: dict[int, str], unknown: int, camera: Camera | None
) -> Iterator[str]:
    if others := names - set(JOINTS):
        yield f"joints that the format does not have were left behind: {', '.join(sorted(others))}"
    if missing := set(JOINTS) - names:
        yield f"joints that were not recorded are NaN and not tracked: {', '.join(sorted(missing))}"
    if unknown:
        yield f"{unknown:,} joints of which nobody knows whether they were tracked are written as not tracked"
    if camera is None:
        yield "places in the depth image are NaN: no depth camera is known"
    if session.manifest.clock.rule != "unknown":
        yield "the times of the frames have no place in the format"
    if any(slots.values()):
        yield f"whose bodies they are has no place in the format: {', '.join(filter(None, slots.values()))}"


FORMAT = replace(ntu.FORMAT, part=part, suffix=".skeleton")
