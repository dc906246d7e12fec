"""MCAP, read back by the readers of mcap, FFmpeg and Rerun."""

from __future__ import annotations

import importlib.util
import io
from collections import defaultdict
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
import pytest
from av.container import InputContainer

from ecat.errors import CorruptError, MissingExtraError, NotFoundError
from ecat.formats import export
from ecat.formats.robotics.mcap import FORMAT
from ecat.formats.robotics.scene import stream_camera
from ecat.geometry.transforms import Rigid
from ecat.model import Camera, Clock, Event, Layer, Manifest, Segment, Stream
from ecat.sample import GroundTruth
from ecat.store import Draft, Session, TableData, create_session
from ecat.store.media import open_images
from tests.formats.robotics.scenes import HIDDEN, bare, exported, table

pytest.importorskip("foxglove", reason="the extra mcap is not installed")
reader = pytest.importorskip("mcap.reader")
decoder = pytest.importorskip("mcap_protobuf.decoder")


@dataclass(frozen=True)
class Message:
    schema: str
    t_ns: int
    data: Any


def written(session: Session, out: Path, **options: str) -> tuple[Path, tuple[str, ...]]:
    return out, exported(FORMAT, session, out, **options)


def messages(path: Path) -> dict[str, list[Message]]:
    """Every message by its topic, in the order of the file."""
    found: dict[str, list[Message]] = defaultdict(list)
    with path.open("rb") as file:
        made = reader.make_reader(file, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        for item in made.iter_decoded_messages(log_time_order=False):
            found[item.channel.topic].append(
                Message(item.schema.name, item.message.log_time, item.decoded_message)
            )
    return found


def ns(moment: Any) -> int:
    return moment.seconds * 1_000_000_000 + moment.nanos


def placed(message: Any) -> Rigid:
    t, q = message.translation, message.rotation
    return Rigid.from_quaternion(np.array([q.x, q.y, q.z, q.w]), np.array([t.x, t.y, t.z]))


@pytest.fixture(scope="module")
def read(session: Session, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Message]]:
    return messages(written(session, tmp_path_factory.mktemp("mcap") / "it.mcap")[0])


def test_every_message_is_of_a_well_known_schema(read: dict[str, list[Message]]) -> None:
    schemas = {topic: {message.schema for message in found} for topic, found in read.items()}
    assert schemas == {
        "/blocks": {"foxglove.SceneUpdate"},
        "/color/calibration": {"foxglove.CameraCalibration"},
        "/color/video": {"foxglove.CompressedVideo"},
        "/depth/calibration": {"foxglove.CameraCalibration"},
        "/depth/image": {"foxglove.RawImage"},
        "/events/main": {"foxglove.Event"},
        "/relations/main": {"foxglove.Event"},
        "/skeleton": {"foxglove.SceneUpdate"},
        "/table": {"foxglove.SceneUpdate"},
        "/tf/block/Shell": {"foxglove.FrameTransform"},
        "/tf/block/Stella_Artois": {"foxglove.FrameTransform"},
        "/tf/camera/color": {"foxglove.FrameTransform"},
        "/tf/camera/depth": {"foxglove.FrameTransform"},
    }


def test_messages_come_in_the_order_of_time_over_all_topics(session: Session, out: Path) -> None:
    path, _ = written(session, out)
    with path.open("rb") as file:
        times = [m.log_time for _, _, m in reader.make_reader(file).iter_messages(log_time_order=False)]
    assert len(times) > 500
    assert times == sorted(times)


# ------------------------------------------------------------------------------------------------ video


def decoded(packets: list[bytes]) -> list[np.ndarray[Any, Any]]:
    with cast("InputContainer", av.open(io.BytesIO(b"".join(packets)), format="h264")) as container:
        return [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]


def nal_types(data: bytes) -> list[int]:
    """Of Annex B data (ITU-T H.264, annex B)."""
    return [data[i + 3] & 0x1F for i in range(len(data) - 3) if data[i : i + 3] == b"\0\0\1"]


def test_video_is_passed_on_packet_by_packet_at_its_own_times(
    session: Session, read: dict[str, list[Message]]
) -> None:
    found = read["/color/video"]
    with open_images(session, "color") as images:
        assert images.t_ns is not None
        assert [message.t_ns for message in found] == images.t_ns.tolist()
        assert [ns(message.data.timestamp) for message in found] == images.t_ns.tolist()
        shown = decoded([message.data.data for message in found])
        assert len(shown) == len(images)
        for ours, theirs in zip(images, shown, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_every_key_frame_has_its_parameters_so_that_a_viewer_can_begin_there(
    read: dict[str, list[Message]],
) -> None:
    keys = [types for m in read["/color/video"] if 5 in (types := nal_types(m.data.data))]
    assert len(keys) > 5
    assert all({7, 8} <= set(types[: types.index(5)]) for types in keys)


def with_video(folder: Path, codec: str, **options: str) -> Session:
    """A session that is nothing but a video of this codec, 24 images."""
    n = 24
    t_ns = np.arange(n) * 40_000_000

    def write(path: Path) -> None:
        with av.open(str(path), "w") as container:
            stream = cast("Any", container.add_stream(codec, rate=25, options=options))
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            for k in range(n):
                image = np.full((48, 64, 3), 5 * k, np.uint8)
                image[10:20, 2 * k : 2 * k + 8] = 255
                frame = av.VideoFrame.from_ndarray(image, format="bgr24")
                frame.pts, frame.time_base = k, Fraction(1, 25)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))

    video = Stream(name="color", kind="color", file="media/color.mkv", camera="color", n_frames=n)
    manifest = Manifest(
        name="video",
        created="2024-01-01T00:00:00",
        n_frames=n,
        streams=(video,),
        clock=Clock(rule="recorded", duration_ns=int(t_ns[-1])),
    )
    rows = table("frames", t_ns=t_ns.tolist(), frame=list(range(n)), stream=["color"] * n)
    return create_session(
        folder, Draft(manifest=manifest, media={"color": write}, tables={"frames": TableData(data=rows)})
    )


def test_h265_is_passed_on_too(tmp_path: Path) -> None:
    session = with_video(tmp_path / "s", "libx265", **{"x265-params": "bframes=0:log-level=none"})
    path, findings = written(session, tmp_path / "out")
    found = messages(path)["/color/video"]
    assert {message.data.format for message in found} == {"h265"}
    assert len(found) == 24
    assert not any("anew" in finding for finding in findings)


def test_b_frames_are_encoded_anew_and_that_is_told(tmp_path: Path) -> None:
    session = with_video(tmp_path / "s", "libx264", bf="3", b_strategy="0")
    path, findings = written(session, tmp_path / "out", qp="10")
    assert any("color: encoded anew as H.264 (qp 10): it has B-frames" in finding for finding in findings)
    shown = decoded([message.data.data for message in messages(path)["/color/video"]])
    with open_images(session, "color") as images:
        for ours, theirs in zip(images, shown, strict=True):
            assert np.abs(ours.astype(int) - theirs).mean() < 3
    assert [p.name for p in tmp_path.iterdir() if p.name not in {"s", "out"}] == []


def test_b_frames_stay_behind_where_nothing_may_be_encoded(tmp_path: Path) -> None:
    session = with_video(tmp_path / "s", "libx264", bf="3", b_strategy="0")
    path, findings = written(session, tmp_path / "out", video="recorded")
    assert any("color: left behind: it has B-frames" in finding for finding in findings)
    assert "/color/video" not in messages(path)


def test_a_codec_without_a_message_is_encoded_anew(tmp_path: Path) -> None:
    session = with_video(tmp_path / "s", "mpeg4")
    path, findings = written(session, tmp_path / "out")
    assert any("it is mpeg4" in finding for finding in findings)
    assert len(messages(path)["/color/video"]) == 24


def test_a_video_that_breaks_off_is_an_error_and_not_a_shorter_one(tmp_path: Path) -> None:
    session = with_video(tmp_path / "s", "libx264", bf="0")
    video = session.stream_path("color")
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with pytest.raises(CorruptError):
        written(session, tmp_path / "out")


# ------------------------------------------------------------------------------------------------ depth


def test_depth_is_what_was_recorded_to_the_last_bit(session: Session, read: dict[str, list[Message]]) -> None:
    with open_images(session, "depth") as images:
        found = read["/depth/image"]
        assert images.t_ns is not None
        assert [message.t_ns for message in found] == images.t_ns.tolist()
        for ours, message in zip(images, found, strict=True):
            assert message.data.encoding == "16UC1"
            theirs = np.frombuffer(message.data.data, "<u2").reshape(message.data.height, -1)
            assert message.data.step == 2 * message.data.width
            np.testing.assert_array_equal(ours, theirs)


def test_what_is_not_wanted_is_left_out_and_named(session: Session, out: Path) -> None:
    path, findings = written(session, out, depth="false", video="none")
    assert not {"/color/video", "/depth/image"} & set(messages(path))
    assert any("streams left behind: color, depth, audio" in finding for finding in findings)


# ------------------------------------------------------------------------------------------------ space


def test_blocks_are_where_they_were_in_the_pixels_of_the_camera(
    filmed: tuple[Session, GroundTruth], read: dict[str, list[Message]]
) -> None:
    """The whole chain, by the messages alone: block -> table -> camera/depth -> camera/color -> pixel."""
    session, truth = filmed
    calibration = read["/color/calibration"][0].data
    assert calibration.frame_id == "camera/color"
    k = np.array(calibration.K).reshape(3, 3)
    table_from_depth = placed(read["/tf/camera/depth"][0].data)
    depth_from_color = placed(read["/tf/camera/color"][0].data)
    camera = stream_camera(session.manifest, session.stream("color"))
    assert camera is not None
    for frame, message in enumerate(read["/tf/block/Stella_Artois"]):
        assert (message.data.parent_frame_id, message.data.child_frame_id) == ("table", "block/Stella_Artois")
        block = placed(message.data).translation
        seen = k @ depth_from_color.inverse().apply(table_from_depth.inverse().apply(block))
        np.testing.assert_allclose(block, truth.position[1, frame], atol=1e-12)
        true = camera.project(truth.scene.depth_from_table.apply(truth.position[1, frame]))
        np.testing.assert_allclose(seen[:2] / seen[2], true, atol=1e-6)


def test_a_block_that_is_lost_disappears_until_it_is_found(read: dict[str, list[Message]]) -> None:
    names = [[entity.id for entity in message.data.entities] for message in read["/blocks"]]
    gone = [[entity.id for entity in message.data.deletions] for message in read["/blocks"]]
    assert names[HIDDEN.start - 1] == ["Shell", "Stella Artois"]
    assert gone[HIDDEN.start] == ["Shell"]
    assert all(names[frame] == ["Stella Artois"] for frame in HIDDEN)
    assert not any(gone[frame] for frame in range(len(gone)) if frame != HIDDEN.start)
    cube = read["/blocks"][0].data.entities[0].cubes[0]
    np.testing.assert_allclose([cube.size.x, cube.size.y, cube.size.z], 0.1524)


def test_a_moving_camera_carries_the_table_in_the_world(tmp_path: Path) -> None:
    n = 5
    depth = Camera(name="depth", width_px=4, height_px=4, fx_px=1, fy_px=1, cx_px=1, cy_px=1)
    manifest = Manifest(
        name="moving",
        created="2024-01-01T00:00:00",
        n_frames=n,
        clock=Clock(rule="uniform", duration_ns=400),
        cameras=(depth,),
    )
    poses = table(
        "camera_poses",
        t_ns=[100 * k for k in range(n)],
        camera=["depth"] * n,
        x=[float(k) for k in range(n)],
        **{name: [0.0] * n for name in ("y", "z", "qx", "qy", "qz")},
        qw=[1.0] * n,
    )
    fit: dict[str, list[float]] = {name: [0.0] for name in ("origin_x", "origin_y", "qx", "qy", "qz")}
    plane = table(
        "table_plane",
        frame=[0],
        n_points=[1],
        n_inliers=[1],
        evidence=["polygon"],
        origin_z=[2.0],
        qw=[1.0],
        **fit,
    )
    tables = {"camera_poses": TableData(data=poses), "table_plane": TableData(data=plane)}
    session = create_session(tmp_path / "s", Draft(manifest=manifest, tables=tables))
    found = messages(written(session, tmp_path / "out")[0])
    travelled = found["/tf/camera/depth"]
    assert [message.t_ns for message in travelled] == [0, 100, 200, 300, 400]
    assert {message.data.parent_frame_id for message in travelled} == {"world"}
    assert [message.data.translation.x for message in travelled] == [0, 1, 2, 3, 4]
    (carried,) = found["/tf/table"]
    assert (carried.data.parent_frame_id, carried.data.translation.z) == ("camera/depth", 2.0)


# ------------------------------------------------------------------------------------------------ events


def test_events_end_with_their_last_nanosecond(session: Session, read: dict[str, list[Message]]) -> None:
    events = {event.id: event for event in session.layer("main").events}
    found = read["/events/main"]
    assert len(found) == len(events)
    for message in found:
        facts = {pair.key: pair.value for pair in message.data.metadata}
        event = events[facts["id"]]
        (segment,) = event.segments
        assert (ns(message.data.start_time), ns(message.data.end_time) + 1) == (
            segment.start_ns,
            segment.end_ns,
        )
        assert message.t_ns == segment.start_ns
        assert facts.get("text", "") == event.text
        assert {key for key in facts if key.startswith("role:")} == {f"role:{r.name}" for r in event.roles}


def test_an_event_in_stretches_is_an_event_for_each(tmp_path: Path) -> None:
    segments = (Segment(start_frame=1, end_frame=3), Segment(start_frame=5, end_frame=5))
    manifest = Manifest(
        name="s", created="2024-01-01T00:00:00", n_frames=11, clock=Clock(rule="uniform", duration_ns=1000)
    )
    layer = Layer(events=(Event(id="a1", type="push", segments=segments),))
    session = create_session(tmp_path / "s", Draft(manifest=manifest, layers=(layer,)))
    found = messages(written(session, tmp_path / "out")[0])["/events/main"]
    spans = [(ns(message.data.start_time), ns(message.data.end_time)) for message in found]
    # one without a length still is at a moment
    assert spans == [(100, 299), (500, 500)]
    assert [{p.key: p.value for p in m.data.metadata}["segment"] for m in found] == ["1/2", "2/2"]


def test_the_annotation_travels_whole_as_an_attachment(session: Session, out: Path) -> None:
    path, _ = written(session, out)
    with path.open("rb") as file:
        (attachment,) = reader.make_reader(file).iter_attachments()
    record = session.manifest.layers[0]
    assert attachment.data == (session.path / record.file).read_bytes()


# ------------------------------------------------------------------------------------------------ time


def test_wall_times_are_the_session_s_shifted(session: Session, tmp_path: Path) -> None:
    by_session = messages(written(session, tmp_path / "a", depth="false")[0])
    path, findings = written(session, tmp_path / "b", depth="false", times="wall")
    by_wall = messages(path)
    start = int(np.datetime64("2024-03-05T10:00:00", "ns").astype(np.int64))
    for topic, found in by_session.items():
        assert [m.t_ns + start for m in found] == [m.t_ns for m in by_wall[topic]]
    assert any("taken for UTC" in finding for finding in findings)


def test_without_a_wall_clock_there_are_no_wall_times(session: Session, tmp_path: Path) -> None:
    manifest = replace(
        session.manifest, clock=Clock(rule="uniform", duration_ns=10), streams=(), layers=(), tables=()
    )
    made = create_session(tmp_path / "s", Draft(manifest=manifest))
    with pytest.raises(NotFoundError, match="MCAP"):
        written(made, tmp_path / "out", times="wall")


def test_a_session_without_a_clock_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError, match="MCAP") as caught:
        written(bare(tmp_path / "s"), tmp_path / "out")
    assert "no clock" in caught.value.where


# ------------------------------------------------------------------------------------------------ the file


def test_the_same_session_gives_the_same_bytes(session: Session, tmp_path: Path) -> None:
    first, second = (Path(export(session.path, tmp_path / name, format="mcap").path) for name in "ab")
    assert first.read_bytes() == second.read_bytes()


def test_without_the_extra_the_error_names_it(
    session: Session, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ecat.formats.robotics.mcap.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError) as caught:
        written(session, out)
    assert "ecat[mcap]" in caught.value.fix
    assert importlib.util.find_spec("foxglove") is not None


def test_rerun_s_reader_shows_video_depth_and_places(session: Session, out: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk")
    path, _ = written(session, out.with_suffix(".mcap"))
    rows: dict[str, int] = defaultdict(int)
    components: dict[str, set[str]] = defaultdict(set)
    for part in chunk.McapReader(str(path), timeline_type="duration_ns").stream():
        names = part.to_record_batch().schema.names
        rows[part.entity_path] += part.num_rows if "message_log_time" in names else 0
        components[part.entity_path] |= {name for name in names if ":" in name}
    with open_images(session, "color") as color, open_images(session, "depth") as depth:
        assert rows["/color/video"] == len(color)
        assert rows["/depth/image"] == len(depth)
    shown = {name: {component.partition(":")[0] for component in found} for name, found in components.items()}
    assert "VideoStream" in shown["/color/video"]
    assert "Pinhole" in shown["/color/calibration"]
    assert "Transform3D" in shown["/tf/block/Shell"]
    assert {"Image", "DepthImage"} & shown["/depth/image"]


def test_times_between_messages_are_those_of_the_recording(read: dict[str, list[Message]]) -> None:
    """Nothing is resampled: the clock of the generated recording trembles, and so do the steps."""
    steps = {b.t_ns - a.t_ns for a, b in pairwise(read["/color/video"])}
    assert len(steps) > 100
