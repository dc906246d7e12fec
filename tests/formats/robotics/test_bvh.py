"""BVH, read back by a reader written here: forward kinematics as the format defines it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats.robotics.bvh import FORMAT, ORDER, local_motion
from ecat.formats.robotics.scene import table_fits
from ecat.formats.robotics.tracks import JOINTS
from ecat.model import Manifest
from ecat.model.skeleton import BONES
from ecat.store import Draft, Session, TableData, create_session
from tests.formats.robotics.scenes import bare, exported, table

Floats = NDArray[np.float64]


@dataclass
class Joint:
    name: str
    parent: Joint | None
    offset: Floats = field(default_factory=lambda: np.zeros(3))
    channels: list[str] = field(default_factory=list[str])


@dataclass
class Bvh:
    """A file as Meredith and Maddock (2001) describe it."""

    joints: list[Joint]
    frame_time: float
    motion: Floats

    def places(self) -> dict[str, Floats]:
        """Where every joint is (f, 3): position channels replace the offset, rotations apply as they are listed."""
        found: dict[str, tuple[Floats, Floats]] = {}
        at = 0
        for joint in self.joints:
            n = len(self.motion)
            move, turn = np.tile(joint.offset, (n, 1)), np.tile(np.eye(3), (n, 1, 1))
            for k, channel in enumerate(joint.channels):
                values, axis = self.motion[:, at + k], "XYZ".index(channel[0])
                if channel.endswith("position"):
                    move[:, axis] = values
                else:
                    turn = turn @ about(axis, np.radians(values))
            at += len(joint.channels)
            if joint.parent is None:
                found[joint.name] = move, turn
            else:
                place, above = found[joint.parent.name]
                found[joint.name] = place + np.einsum("fij,fj->fi", above, move), above @ turn
        return {name: place for name, (place, _) in found.items()}


def about(axis: int, angle: Floats) -> Floats:
    turn = np.tile(np.eye(3), (len(angle), 1, 1))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[:, a, a] = turn[:, b, b] = np.cos(angle)
    turn[:, b, a], turn[:, a, b] = np.sin(angle), -np.sin(angle)
    return turn


def read(path: Path) -> Bvh:
    words = path.read_text().split()
    assert words[0] == "HIERARCHY"
    joints: list[Joint] = []
    open_joints: list[Joint | None] = [None]
    k, end_site = 1, False
    while words[k] != "MOTION":
        match words[k]:
            case "ROOT" | "JOINT":
                joints.append(Joint(words[k + 1], open_joints[-1]))
                k += 2
            case "End":
                end_site, k = True, k + 2
            case "{":
                open_joints.append(None if end_site else joints[-1])
                k += 1
            case "}":
                open_joints.pop()
                end_site, k = False, k + 1
            case "OFFSET":
                if not end_site:
                    joints[-1].offset = np.array(words[k + 1 : k + 4], float)
                k += 4
            case "CHANNELS":
                n = int(words[k + 1])
                joints[-1].channels = words[k + 2 : k + 2 + n]
                k += 2 + n
            case other:
                pytest.fail(f"unexpected {other}")
    assert open_joints == [None]
    n_frames, step = int(words[k + 2]), float(words[k + 5])
    width = sum(len(joint.channels) for joint in joints)
    return Bvh(joints, step, np.array(words[k + 6 :], float).reshape(n_frames, width))


def upright(session: Session) -> Floats:
    """Joints of the session's one body (f, 25, 3) as the file should have them: table, y up."""
    rows = session.table("joints").to_pandas()
    points = np.stack(
        [
            rows.pivot_table(index="frame", columns="joint", values=axis, observed=True)[list(JOINTS)]
            for axis in "xyz"
        ],
        axis=-1,
    )
    fits = table_fits(session)
    assert fits is not None
    x, y, z = np.moveaxis(fits.at(0).apply(points), -1, 0)
    return np.stack([x, z, -y], -1)


def test_every_joint_is_where_it_was_measured_within_a_tenth_of_a_millimetre(
    session: Session, out: Path
) -> None:
    exported(FORMAT, session, out)
    places = read(out / "Performer_1.bvh").places()
    true = upright(session)
    assert list(places) == list(ORDER)
    for j, name in enumerate(JOINTS):
        np.testing.assert_allclose(places[name], true[:, j], atol=1e-4)


def test_at_rest_bones_are_as_long_as_their_median(session: Session, out: Path) -> None:
    exported(FORMAT, session, out)
    offsets = {joint.name: joint.offset for joint in read(out / "Performer_1.bvh").joints}
    true = upright(session)
    for a, b in BONES:
        measured = np.linalg.norm(true[:, JOINTS.index(a)] - true[:, JOINTS.index(b)], axis=-1)
        assert np.linalg.norm(offsets[b]) == pytest.approx(np.median(measured), abs=2e-6)


def test_at_rest_the_body_stands_with_its_arms_spread_and_faces_us(session: Session, out: Path) -> None:
    exported(FORMAT, session, out)
    offsets = {joint.name: joint.offset for joint in read(out / "Performer_1.bvh").joints}
    assert offsets["Head"][1] > 0
    assert offsets["KneeLeft"][1] < 0
    assert offsets["ElbowLeft"][0] > 0
    assert offsets["ElbowRight"][0] < 0
    assert offsets["FootLeft"][2] > 0


def test_rigid_bones_keep_their_length_and_how_far_joints_are_off_is_told(
    session: Session, out: Path
) -> None:
    told = exported(FORMAT, session, out, bones="rigid")
    found = read(out / "Performer_1.bvh")
    assert {len(joint.channels) for joint in found.joints[1:]} == {3}
    places, true = found.places(), upright(session)
    off = np.max([np.linalg.norm(places[name] - true[:, j], axis=-1) for j, name in enumerate(JOINTS)], 0)
    (line,) = [line for line in told if "mm off" in line]
    assert f"{np.median(off) * 1000:.0f} mm off (median), {off.max() * 1000:.0f} mm" in line
    for a, b in BONES:
        lengths = np.linalg.norm(places[a] - places[b], axis=-1)
        assert np.ptp(lengths) < 1e-5


def test_there_is_a_line_for_each_frame_and_their_step_is_the_median(session: Session, out: Path) -> None:
    told = exported(FORMAT, session, out)
    found = read(out / "Performer_1.bvh")
    assert len(found.motion) == session.manifest.n_frames
    assert found.frame_time == pytest.approx(1 / 29.95, rel=0.01)
    assert any("true times differ by up to" in line for line in told)


@given(
    arrays(np.float64, (4, len(JOINTS), 3), elements=st.floats(-2, 2)),
    arrays(np.float64, (len(JOINTS), 3), elements=st.floats(0.01, 1)),
    st.booleans(),
)
def test_motion_of_any_joints_is_made_of_rotations(joints: Floats, offsets: Floats, rigid: bool) -> None:
    turns, moves, reached = local_motion(joints, offsets, rigid=rigid)
    np.testing.assert_allclose(
        turns @ np.swapaxes(turns, -1, -2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(turns), 1, atol=1e-9)
    if not rigid:
        np.testing.assert_array_equal(reached, joints)
    assert np.isfinite(moves).all()


def gappy(folder: Path) -> Session:
    """Two bodies without a clock or a table: one is away for a while, the other's head is never seen."""
    rows: list[dict[str, object]] = []
    for frame in range(10):
        for body in (0, 3):
            if body == 0 and frame in {4, 5}:
                continue
            for j, joint in enumerate(JOINTS):
                if (body, joint) != (3, "Head"):
                    rows.append(
                        {
                            "frame": frame,
                            "body": body,
                            "joint": joint,
                            "x": 0.01 * j * frame,
                            "y": 0.02 * j,
                            "z": 2.0,
                        }
                    )
    columns = {name: [row[name] for row in rows] for name in ("frame", "body", "joint", "x", "y", "z")}
    manifest = Manifest(name="gappy", created="2024-01-01T00:00:00", n_frames=10)
    return create_session(
        folder, Draft(manifest=manifest, tables={"joints": TableData(data=table("joints", **columns))})
    )


def test_what_is_not_known_stays_as_it_was(tmp_path: Path, out: Path) -> None:
    told = exported(FORMAT, gappy(tmp_path / "s"), out)
    assert sorted(path.name for path in out.iterdir()) == ["body_0.bvh", "body_3.bvh"]
    first = read(out / "body_0.bvh")
    places = first.places()
    assert len(first.motion) == 10
    np.testing.assert_allclose(places["Neck"][4], places["Neck"][3], atol=1e-6)
    np.testing.assert_allclose(places["Neck"][5], places["Neck"][3], atol=1e-6)
    j = JOINTS.index("Neck")
    # without a table the camera looks ahead: y up, z towards it
    np.testing.assert_allclose(places["Neck"][9], [0.09 * j, -0.02 * j, -2.0], atol=1e-5)
    assert np.isfinite(read(out / "body_3.bvh").motion).all()
    assert any("body_0: 0 joints and 2 frames" in line for line in told)
    assert any("body_3: 10 joints and 0 frames" in line for line in told)
    assert any("30 a second" in line for line in told)


def test_a_session_without_bodies_is_refused(tmp_path: Path, out: Path) -> None:
    with pytest.raises(NotFoundError):
        exported(FORMAT, bare(tmp_path / "s"), out)
