"""Loose files of ECAT's recorder."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from ecat.check import check
from ecat.errors import FormatError
from ecat.formats import import_source, registry
from ecat.formats.ecat2018.body_scheme import KINECT_V2
from ecat.formats.ecat2018.depth_file import write_depth_file
from ecat.formats.ecat2018.rig import RIG_SCHEMA, write_rig
from ecat.store import find_sessions, open_session
from ecat.store.media import open_images
from tests.store.media.clips import color_image, depth_image, number_of

N = 12
STAMP = "2017-10-04-22-35"


def video(path: Path) -> Path:
    """As the recorder wrote it: MPEG-4 part 2 in AVI, 30 images a second."""
    import av

    with av.open(str(path), "w") as out:
        stream = out.add_stream("mpeg4", rate=30, options={"q:v": "2"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(N):
            frame = av.VideoFrame.from_ndarray(color_image(i), format="bgr24").reformat(format="yuv420p")
            frame.pts, frame.time_base = i, Fraction(1, 30)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def rig(path: Path, times_ms: list[int]) -> Path:
    n = len(KINECT_V2.joints)
    rows = [
        {
            "record": i,
            "t_ns": t * 1_000_000,
            "recorded_at": None,
            "counter": i + 1,
            "body": 2,
            "joint": joint.name,
            **dict.fromkeys(("x", "y", "z", "u_px", "v_px", "depth_u_px", "depth_v_px"), float(i)),
            "confidence": 1.0,
            "state": "tracked",
        }
        for i, t in enumerate(times_ms)
        for joint in KINECT_V2.joints
    ]
    assert len(rows) == n * len(times_ms)
    path.write_bytes(b"".join(write_rig(pa.Table.from_pylist(rows, schema=RIG_SCHEMA))))
    return path


def recording(folder: Path, stamp: str = STAMP, times_ms: list[int] | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    video(folder / f"rgb_{stamp}.avi")
    times = times_ms or [33 * i + 5 for i in range(N)]
    write_depth_file(folder / f"depth_{stamp}.dep", [(t, depth_image(i)) for i, t in enumerate(times)])
    rig(folder / f"rig_{stamp}.xml", [0, 101, 340])
    return folder


def test_video_depth_and_skeletons_become_one_session(tmp_path: Path) -> None:
    report = import_source(recording(tmp_path / "in"), tmp_path / "s")
    session = open_session(report.path)
    assert report.format == "ecat-recorder"
    color, depth = open_images(session, "color"), open_images(session, "depth")
    assert [number_of(image) for image in color] == list(range(N))
    assert color.t_ns is not None
    assert np.abs(color.t_ns - np.arange(N) * 1e9 / 30).max() < 1000
    np.testing.assert_array_equal(depth.t_ns, (33 * np.arange(N) + 5) * 1_000_000)
    for i, image in enumerate(depth):
        np.testing.assert_array_equal(image, depth_image(i))
    joints = session.table("joints").to_arrow()
    assert joints["frame"].to_pylist()[::25] == [0, 3, 10]
    assert set(joints["body"].to_pylist()) == {2}
    assert {camera.name for camera in session.manifest.cameras} == {"color", "depth"}
    assert [f for f in check(report.path) if f.severity == "error"] == []


def test_depth_out_of_order_is_sorted_and_told(tmp_path: Path) -> None:
    times = [5, 71, 38, *(33 * i + 5 for i in range(3, N))]
    report = import_source(recording(tmp_path / "in", times_ms=times), tmp_path / "s")
    images = list(open_images(open_session(report.path), "depth"))
    np.testing.assert_array_equal(images[1], depth_image(2))
    np.testing.assert_array_equal(images[2], depth_image(1))
    assert any("frame 2 is earlier than frame 1" in finding for finding in report.findings)


def test_depth_of_a_recorder_that_crashed_is_kept_without_times(tmp_path: Path) -> None:
    source = recording(tmp_path / "in")
    path = source / f"depth_{STAMP}.dep"
    path.write_bytes(path.read_bytes()[:-20])
    report = import_source(source, tmp_path / "s")
    images = open_images(open_session(report.path), "depth")
    assert len(images) == N
    np.testing.assert_array_equal(next(iter(images)), depth_image(0))
    assert any("times are unknown" in finding for finding in report.findings)


@pytest.mark.parametrize("suffix", [".avi", ".dep", ".xml"])
def test_one_broken_file_does_not_take_the_others_along(tmp_path: Path, suffix: str) -> None:
    source = recording(tmp_path / "in")
    next(source.glob(f"*{suffix}")).write_bytes(b"x")
    report = import_source(source, tmp_path / "s")
    session = open_session(report.path)
    assert len(session.manifest.streams) == (2 if suffix == ".xml" else 1)
    assert any("cannot be read and was left out" in finding for finding in report.findings)


def test_several_recordings_become_a_project(tmp_path: Path) -> None:
    for stamp in ("a", "b"):
        recording(tmp_path / "in", stamp)
    report = import_source(tmp_path / "in", tmp_path / "p")
    assert [path.name for path in find_sessions(report.path)] == ["a", "b"]


def test_nothing_readable_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "depth.dep").write_bytes(b"")
    assert registry.sniff(tmp_path / "in").name == "ecat-recorder"
    with pytest.raises(FormatError, match="cannot import"):
        import_source(tmp_path / "in", tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_a_session_of_ecat_plays_its_video_and_depth(tmp_path: Path) -> None:
    source = recording(tmp_path / "Session1")
    names = sorted(path.name for path in source.iterdir())
    listed = "".join(f"<file>{name}</file>" for name in names)
    (source / "files.param").write_text(
        f'<session name="Session1" length="{N}" duration="400"><files>{listed}</files>'
        '<objects no="0"></objects><annotations></annotations></session>'
    )
    report = import_source(source, tmp_path / "s")
    assert report.format == "ecat-2018"
    session = open_session(find_sessions(report.path)[0])
    streams = {stream.kind: stream.name for stream in session.manifest.streams}
    assert [number_of(image) for image in open_images(session, streams["color"])] == list(range(N))
    np.testing.assert_array_equal(next(iter(open_images(session, streams["depth"]))), depth_image(0))


def test_a_recording_of_several_that_cannot_be_read_is_left_out_only_if_asked_for(tmp_path: Path) -> None:
    source = recording(tmp_path / "in", "a")
    for name in ("depth_b.dep", "rig_b.xml"):
        (source / name).write_bytes(b"")
    with pytest.raises(FormatError, match="cannot import"):
        import_source(source, tmp_path / "all")
    assert not (tmp_path / "all").exists()
    report = import_source(source, tmp_path / "rest", keep_going=True)
    assert [path.name for path in find_sessions(report.path)] == ["a"]
    assert any("b was left out" in finding for finding in report.findings)


def test_skeletons_alone_are_a_session_of_as_many_frames_as_were_counted(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    rig(tmp_path / "in" / f"rig_{STAMP}.xml", [0, 101, 340])
    report = import_source(tmp_path / "in", tmp_path / "s")
    session = open_session(report.path)
    assert (session.manifest.n_frames, session.manifest.clock.rule) == (3, "unknown")
    joints = session.table("joints").to_arrow()
    assert set(joints["frame"].to_pylist()) == {0, 1, 2}
    assert joints["t_ns"].null_count == joints.num_rows == 3 * len(KINECT_V2.joints)
    assert {"there is no colour video", "there is no depth file"} < set(report.findings)
    assert any("the skeletons' times are left out" in finding for finding in report.findings)
    assert [f for f in check(report.path) if f.severity == "error"] == []
