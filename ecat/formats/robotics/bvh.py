"""Skeletons as BVH (Biovision hierarchy), which animation programs read: a file per body.

Source: Meredith and Maddock, Motion capture file formats explained, 2001.  The hierarchy is that of the Kinect's bones;
at rest the body stands upright with its arms spread and every bone as long as its median in the recording.  Metres, y
up: ``table`` with its z axis up, or the depth camera's frame turned upright where no table is known.

Carried: where every joint was, to less than a tenth of a millimetre (joints have channels for their place), one line of
motion a frame.  Left behind: the clock but for its median step, whether a joint was tracked, gaps (what is not known
stays as it was).  With ``bones=rigid`` bones keep their length, as animators prefer, and joints are only near.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats.format import Format
from ecat.formats.options import option
from ecat.formats.robotics import tracks
from ecat.formats.robotics.scene import TableFits, file_names, frame_times, table_fits, things_of
from ecat.formats.robotics.tracks import JOINTS
from ecat.geometry.transforms import Floats, Rigid, known
from ecat.model.skeleton import BONES
from ecat.progress import Progress
from ecat.store import Session

_SAMPLES = 1 << 14
_USUAL_BONE_M, _END_M = 0.1, 0.05
_USUAL_STEP_S = 1 / 30
_UP, _SIDE, _FORWARD = np.eye(3)[[1, 0, 2]]
_TURN = {  # to y up: from a table with z up, and from a camera that looks along z with y down
    "table": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "camera": np.diag([1.0, -1.0, -1.0]),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class BvhOptions:
    """How bones that seem to change their length are written."""

    bones: Literal["measured", "rigid"] = option(
        "measured",
        "every joint where it was measured, by channels of its own; or bones of their median length that only turn",
    )


def _children() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {name: [] for name in JOINTS}
    for parent, child in BONES:
        found[parent].append(child)
    return found


_CHILDREN = _children()
_PARENT = {child: parent for parent, child in BONES}
ROOT = next(name for name in JOINTS if name not in _PARENT)


def _downwards(name: str = ROOT) -> Iterator[str]:
    yield name
    for child in _CHILDREN[name]:
        yield from _downwards(child)


ORDER = tuple(_downwards())
"""Joints as the file has them: each before its children."""


def _rest_direction(name: str) -> Floats:
    """Unit vector (3,) from a joint's parent to it at rest, y up, the body facing +z, its left at +x."""
    part = name.removesuffix("Left").removesuffix("Right")
    side = _SIDE if name.endswith("Left") else -_SIDE
    if part in {"Shoulder", "Elbow", "Wrist", "Hand", "HandTip"}:
        return side
    if part == "Hip":
        return (side - 0.3 * _UP) / np.hypot(1, 0.3)
    if part in {"Knee", "Ankle"}:
        return -_UP
    if part == "Foot":
        return _FORWARD
    return (side + _FORWARD) / np.sqrt(2) if part == "Thumb" else _UP


@dataclass
class _Body:
    """What a first look at the recording tells of a body: when it is seen, its bones, where joints first are."""

    first: int = -1
    last: int = -1
    start: Floats = field(default_factory=lambda: np.full((len(JOINTS), 3), np.nan))
    samples: list[Floats] = field(default_factory=list[Floats])
    n_seen: int = 0
    n_missing: int = 0

    def look(self, frame: NDArray[np.int64], joints: Floats, every: int) -> None:
        """Take in joints (f, 25, 3) of frames (f,) in which the body is."""
        if not len(frame):
            return
        self.first, self.last = (int(frame[0]) if self.first < 0 else self.first), int(frame[-1])
        there = known(joints)
        self.n_seen += len(frame)
        self.n_missing += int((~there).sum())
        for j in np.flatnonzero(np.isnan(self.start[:, 0]) & there.any(0)):
            self.start[j] = joints[np.argmax(there[:, j]), j]
        self.samples.append(joints[frame % every == 0])

    def offsets(self) -> Floats:
        """From each joint's parent to it at rest (25, 3), metres.

        Bones of a joint with several keep their angles to each other: shoulders do not sit straight above a spine.
        """
        joints = np.concatenate(self.samples)
        found = np.zeros((len(JOINTS), 3))
        for name in ORDER:
            children = [JOINTS.index(child) for child in _CHILDREN[name]]
            rest = np.array([_rest_direction(child) for child in _CHILDREN[name]]).reshape(-1, 3)
            bones = joints[:, children] - joints[:, JOINTS.index(name), None]
            whole = bones[known(bones, 2)] if children else bones[:0]
            if len(children) > 1 and len(whole):
                eye = np.broadcast_to(np.eye(3), (len(whole), 3, 3))
                back = np.swapaxes(_turned(eye, rest, whole), -1, -2)
                rest = np.median(np.einsum("fij,fcj->fci", back, whole), 0)
                rest /= np.maximum(np.linalg.norm(rest, axis=-1, keepdims=True), 1e-9)
            for child, direction, bone in zip(children, rest, np.swapaxes(bones, 0, 1), strict=True):
                measured = np.linalg.norm(bone[known(bone)], axis=-1)
                found[child] = direction * (np.median(measured) if len(measured) else _USUAL_BONE_M)
        return found


def part(
    session: Session, label: str, dest: Path, options: BvhOptions, progress: Progress
) -> tuple[str, ...]:
    """Write a folder with a file for each body.

    Raises
    ------
    NotFoundError : the session has no bodies.
    """
    slots = tracks.body_slots(session)
    fits = table_fits(session)
    seen = _look(session, list(slots), fits) if slots else {}
    if not seen:
        raise NotFoundError(
            f"cannot write the skeletons of {label}",
            where=f"{session.name}: there is no body with a Kinect's joints",
            consequence="this session was not written",
            fix=f"ecat info {session.path} tells what was recorded",
        )
    things = things_of(session)
    names = file_names([things[slots[b]].name if slots[b] else f"body_{b}" for b in seen])
    dest.mkdir()
    findings = [] if fits is not None else ["no table is known: the depth camera is taken to stand upright"]
    step_s, told = _step(session, seen)
    findings += told
    for name, (slot, body) in zip(names, seen.items(), strict=True):
        with tracks.new_text(dest / f"{name}.bvh") as out:
            motion = _Motion(body, options.bones)
            out.writelines(_hierarchy(motion.offsets, options.bones))
            out.write(f"MOTION\nFrames: {body.last - body.first + 1}\nFrame Time: {step_s:.9f}\n")
            for stretch in _joints(session, list(slots), fits):
                progress(f"writing {label}: {name}", int(stretch[0][-1]), session.manifest.n_frames)
                motion.write(stretch[0], stretch[1][:, list(slots).index(slot)], out)
            motion.rest(out)
        findings += motion.findings(name)
    return tuple(findings)


def _look(session: Session, slots: list[int], fits: TableFits | None) -> dict[int, _Body]:
    """Each body that has joints, by its slot."""
    found = {slot: _Body() for slot in slots}
    every = max(session.manifest.n_frames // _SAMPLES, 1)
    for frame, joints in _joints(session, slots, fits):
        for b, body in enumerate(found.values()):
            there = known(joints[:, b]).any(-1)
            body.look(frame[there], joints[there, b], every)
    return {slot: body for slot, body in found.items() if body.first >= 0}


def _joints(
    session: Session, slots: list[int], fits: TableFits | None
) -> Iterator[tuple[NDArray[np.int64], Floats]]:
    """Frames (f,) and joints (f, b, 25, 3), y up."""
    for stretch in tracks.bodies(session, slots):
        points = stretch.position
        if fits is None:
            yield stretch.frame, points @ _TURN["camera"].T
        else:
            place = fits.at_each(stretch.frame)
            each = Rigid(place.rotation[:, None, None], place.translation[:, None, None])
            yield stretch.frame, each.apply(points) @ _TURN["table"].T


def _step(session: Session, seen: dict[int, _Body]) -> tuple[float, list[str]]:
    """The one time between frames that the format has, seconds, and what is told of it."""
    times = frame_times(session)
    first, last = min(b.first for b in seen.values()), max(b.last for b in seen.values())
    steps = np.diff(times[first : last + 1]) if times is not None else np.zeros(0)
    if times is None or not len(steps):
        return _USUAL_STEP_S, ["the time between frames is not known; 30 a second were taken"]
    step = float(np.median(steps))
    drift = times[first : last + 1] - times[first] - step * np.arange(last - first + 1)
    worst = float(np.abs(drift).max()) / 1e6
    return step / 1e9, [
        f"every frame takes {step / 1e6:.3f} ms in the file; true times differ by up to {worst:.1f} ms"
    ]


def _hierarchy(offsets: Floats, bones: str) -> Iterator[str]:
    """The skeleton at rest."""

    def joint(name: str, depth: int) -> Iterator[str]:
        pad = "\t" * depth
        yield f"{pad}{'ROOT' if name == ROOT else 'JOINT'} {name}\n{pad}{{\n"
        yield f"{pad}\tOFFSET {_text(offsets[JOINTS.index(name)])}\n"
        yield f"{pad}\tCHANNELS {_channels(name, bones)}\n"
        for child in _CHILDREN[name]:
            yield from joint(child, depth + 1)
        if not _CHILDREN[name]:
            yield f"{pad}\tEnd Site\n{pad}\t{{\n{pad}\t\tOFFSET {_text(_rest_direction(name) * _END_M)}\n{pad}\t}}\n"
        yield f"{pad}}}\n"

    yield "HIERARCHY\n"
    yield from joint(ROOT, 0)


def _channels(name: str, bones: str) -> str:
    turns = "Zrotation Xrotation Yrotation"
    if name != ROOT and bones == "rigid":
        return f"3 {turns}"
    return f"6 Xposition Yposition Zposition {turns}"


def _text(values: Floats) -> str:
    return " ".join(f"{value:.6f}" for value in values.tolist())


class _Motion:
    """Writes the lines of one body, one a frame."""

    def __init__(self, body: _Body, bones: str) -> None:
        self._body, self._bones = body, bones
        self.offsets = body.offsets()
        self._next = body.first
        self._last = _whole(body.start, self.offsets)
        self._off_m: list[Floats] = []

    def write(self, frame: NDArray[np.int64], joints: Floats, out: TextIOWrapper) -> None:
        """Lines up to the last of the frames (f,) with joints (f, 25, 3)."""
        inside = (frame >= self._next) & (frame <= self._body.last)
        if not inside.any():
            return
        frame, joints = frame[inside], joints[inside]
        every = np.full((int(frame[-1]) - self._next + 1, len(JOINTS), 3), np.nan)
        every[frame - self._next] = joints
        self._next = int(frame[-1]) + 1
        self._put(_held(every, self._last), out)

    def rest(self, out: TextIOWrapper) -> None:
        """The lines up to the last frame, should there be none of its joints left."""
        if (n := self._body.last - self._next + 1) > 0:
            self._put(np.repeat(self._last[None], n, 0), out)

    def _put(self, joints: Floats, out: TextIOWrapper) -> None:
        self._last = joints[-1]
        turns, moves, reached = local_motion(joints, self.offsets, rigid=self._bones == "rigid")
        if self._bones == "rigid":
            self._off_m.append(np.linalg.norm(reached - joints, axis=-1).max(-1))
        columns: list[Floats] = []
        for name in ORDER:
            j = JOINTS.index(name)
            if name == ROOT or self._bones == "measured":
                columns.append(moves[:, j])
            columns.append(np.degrees(_zxy(turns[:, j])))
        rows = np.concatenate(columns, -1)
        line = " ".join(["%.6f"] * rows.shape[1]) + "\n"
        out.writelines(line % tuple(row) for row in rows.tolist())

    def findings(self, name: str) -> Iterator[str]:
        """What was made up or is not exact."""
        held = self._body.last - self._body.first + 1 - self._body.n_seen
        if self._body.n_missing or held:
            yield (
                f"{name}: {self._body.n_missing:,} joints and {held:,} frames that are not known "
                "stay as they were before"
            )
        if self._off_m:
            off = np.concatenate(self._off_m) * 1000
            yield (
                f"{name}: with bones of one length the worst joint of a frame is {np.median(off):.0f} mm off (median), "
                f"{off.max():.0f} mm at most"
            )


def _whole(start: Floats, offsets: Floats) -> Floats:
    """The first known place of every joint (25, 3); of those never known, where they are at rest."""
    found = start.copy()
    for name in ORDER:
        j = JOINTS.index(name)
        if np.isnan(found[j, 0]):
            found[j] = 0.0 if name == ROOT else found[JOINTS.index(_PARENT[name])] + offsets[j]
    return found


def _held(joints: Floats, before: Floats) -> Floats:
    """Joints (f, 25, 3) where what is not known stays as it was, at first as ``before`` (25, 3)."""
    whole = np.concatenate([before[None], joints])
    at = np.where(known(whole), np.arange(len(whole))[:, None], 0)
    return np.take_along_axis(whole, np.maximum.accumulate(at, 0)[..., None], 0)[1:]


def local_motion(joints: Floats, offsets: Floats, *, rigid: bool) -> tuple[Floats, Floats, Floats]:
    """Joints (f, 25, 3) as motion of the skeleton whose bones at rest are ``offsets`` (25, 3), joints as in ``JOINTS``.

    Returns
    -------
    Rotations (f, 25, 3, 3) and places (f, 25, 3) of each joint in its parent's frame, and where the joints come to be,
    (f, 25, 3): with ``rigid`` bones of their length at rest, else where they are.
    """
    turns, moves = np.zeros((*joints.shape, 3)), np.zeros_like(joints)
    whole, reached = np.zeros_like(turns), np.zeros_like(joints)
    for name in ORDER:
        j = JOINTS.index(name)
        parent = JOINTS.index(_PARENT[name]) if name != ROOT else None
        above = np.broadcast_to(np.eye(3), whole[:, j].shape) if parent is None else whole[:, parent]
        children = [JOINTS.index(child) for child in _CHILDREN[name]]
        whole[:, j] = _turned(above, offsets[children], joints[:, children] - joints[:, j, None])
        back = np.swapaxes(above, -1, -2)
        turns[:, j] = back @ whole[:, j]
        if parent is None:
            moves[:, j] = reached[:, j] = joints[:, j]
        elif rigid:
            moves[:, j] = offsets[j]
            reached[:, j] = reached[:, parent] + (above @ offsets[j])
        else:
            moves[:, j] = np.einsum("fij,fj->fi", back, joints[:, j] - joints[:, parent])
            reached[:, j] = joints[:, j]
    return turns, moves, reached


def _turned(above: Floats, rest: Floats, measured: Floats) -> Floats:
    """Rotations (f, 3, 3) that bring bones at rest (c, 3) nearest to measured ones (f, c, 3), as little turned against
    ``above`` (f, 3, 3) as they can be (Kabsch's method, with a small vote for ``above``).
    """
    if not len(rest):
        return above
    units = [
        bones / np.maximum(np.linalg.norm(bones, axis=-1, keepdims=True), 1e-9) for bones in (measured, rest)
    ]
    votes = np.einsum("fci,cj->fij", *units) + 1e-3 * above
    u, _, v = np.linalg.svd(votes)
    flip = np.ones((len(above), 3))
    flip[:, 2] = np.sign(np.linalg.det(u @ v))
    return (u * flip[:, None]) @ v


def _zxy(rotation: Floats) -> Floats:
    """Angles (..., 3) about z, x, y, radians, of rotations (..., 3, 3) = Rz Rx Ry."""
    x = np.arcsin(np.clip(rotation[..., 2, 1], -1.0, 1.0))
    z = np.arctan2(-rotation[..., 0, 1], rotation[..., 1, 1])
    y = np.arctan2(-rotation[..., 2, 0], rotation[..., 2, 2])
    return np.stack([z, x, y], -1)


FORMAT = Format(
    name="bvh",
    description="skeletons as BVH for animation programs: a file per body, every joint where it was",
    part=part,
    options=BvhOptions,
)
