"""NTU's skeletons written, and read back by the reader of that format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats import export, import_source
from ecat.formats.recordings.ntu import parse
from ecat.formats.robotics.ntu import FORMAT, frame_lines
from ecat.formats.robotics.tracks import JOINTS, Bodies
from ecat.store import Session, open_session
from tests.formats.robotics.scenes import bare, exported

_SHAPE = (3, 2, len(JOINTS))


@st.composite
def bodies(draw: st.DrawFn) -> Bodies:
    """Two bodies in three frames, each seen or not, each joint known or not."""
    lengths = st.floats(-100, 100) | st.just(np.nan)
    position = draw(arrays(np.float64, (*_SHAPE, 3), elements=lengths))
    pixel = draw(arrays(np.float64, (*_SHAPE, 2), elements=st.floats(-1e5, 1e5) | st.just(np.nan)))
    state = draw(arrays(np.int8, _SHAPE, elements=st.integers(0, 2)))
    seen: NDArray[np.bool_] = draw(arrays(np.bool_, _SHAPE[:2]))
    return Bodies(np.arange(3), None, seen, position, pixel, state)


@given(bodies())
def test_what_the_format_has_a_place_for_comes_back_equal(drawn: Bodies) -> None:
    text = "3\n" + "".join(line for f in range(3) for line in frame_lines(drawn, f, [4, 7], None))
    found = parse(text.encode())
    assert found.notes == []
    assert found.frame.tolist() == [f for f in range(3) for b in range(2) if drawn.seen[f, b]]
    # the reader numbers bodies as they appear
    slots = list(dict.fromkeys(b for f in range(3) for b in range(2) if drawn.seen[f, b]))
    assert found.body.tolist() == [slots.index(b) for f in range(3) for b in range(2) if drawn.seen[f, b]]
    np.testing.assert_array_equal(found.values[..., :3], drawn.position[drawn.seen])
    np.testing.assert_array_equal(found.values[..., 3:5], drawn.pixel[drawn.seen])
    np.testing.assert_array_equal(found.values[..., 5], drawn.state[drawn.seen])


def test_a_session_that_was_exported_and_imported_has_the_same_joints(
    session: Session, tmp_path: Path
) -> None:
    export(session.path, tmp_path / "it.skeleton", format="ntu-skeleton")
    import_source(tmp_path / "it.skeleton", tmp_path / "back")
    back = open_session(tmp_path / "back")
    assert back.manifest.n_frames == session.manifest.n_frames
    ours, theirs = (s.table("joints").to_pandas() for s in (session, back))
    columns = ["frame", "joint", "x", "y", "z", "u_px", "v_px", "state"]
    order = ["frame", "joint"]
    a, b = (df[columns].astype({"joint": str, "state": str}).sort_values(order) for df in (ours, theirs))
    assert a.reset_index(drop=True).equals(b.reset_index(drop=True))


def test_frames_without_a_body_are_there(session: Session, out: Path) -> None:
    exported(FORMAT, session, out)
    text = out.read_text().splitlines()
    assert int(text[0]) == session.manifest.n_frames
    assert parse(out.read_bytes()).n_frames == session.manifest.n_frames


def test_places_in_the_depth_image_are_those_of_its_camera(session: Session, out: Path) -> None:
    exported(FORMAT, session, out)
    head = [float(number) for number in out.read_text().splitlines()[4 + JOINTS.index("Head")].split()]
    camera = session.manifest.camera("depth")
    assert camera is not None
    x, y, z, u, v = head[:5]
    # x, y of the file are Kinect camera space: left and up; the image is mirrored
    assert u == pytest.approx(camera.cx_px + camera.fx_px * x / z, abs=1e-6)
    assert v == pytest.approx(camera.cy_px - camera.fy_px * y / z, abs=1e-6)


def test_what_stays_behind_is_told(session: Session, out: Path) -> None:
    told = exported(FORMAT, session, out)
    assert any("times" in line for line in told)
    assert any("o1" in line for line in told)


def test_a_session_without_bodies_is_refused(tmp_path: Path, out: Path) -> None:
    with pytest.raises(NotFoundError):
        exported(FORMAT, bare(tmp_path / "s"), out)
