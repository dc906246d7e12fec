"""A sample session with pixels: what is in its streams, at which times, and what is told of it beside it."""

from __future__ import annotations

import wave
from pathlib import Path

import cv2
import numpy as np
import pytest

from ecat.cli import main
from ecat.errors import UsageError
from ecat.model import Manifest
from ecat.sample import GroundTruth, sample_session
from ecat.sample.pixels.image_truth import moments
from ecat.sample.recording import BEEP_HZ, BEEP_S, SOUND_HZ, Recording, sample_recording, sound
from ecat.store import Session, create_session, open_session
from ecat.store.media import open_images

SIZE = (320, 180)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return sample_recording(
        seed=4, actions=["toward"], name="made", size=SIZE, cameras=2, depth_size=(128, 106), depth_every=2
    )


@pytest.fixture(scope="module")
def session(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Session:
    dest = tmp_path_factory.mktemp("recorded") / "made"
    create_session(dest, recording.draft)
    return open_session(dest)


def test_what_happens_is_what_happens_without_pixels(recording: Recording) -> None:
    truth: GroundTruth = sample_session(seed=4, actions=["toward"])[1]
    assert recording.truth.position.tobytes() == truth.position.tobytes()
    assert recording.truth.joints.tobytes() == truth.joints.tobytes()
    assert (recording.truth.scene.color.width, recording.truth.scene.color.height) == SIZE
    assert recording.truth.pixels == pytest.approx((truth.pixels + 0.5) / 6 - 0.5)


def test_streams_are_as_the_manifest_says(session: Session, recording: Recording) -> None:
    manifest: Manifest = session.manifest
    assert [(s.name, s.kind, s.present) for s in manifest.streams] == [
        ("color", "color", True),
        ("color2", "color", True),
        ("depth", "depth", True),
        ("audio", "audio", True),
    ]
    assert manifest.n_frames == recording.truth.n_frames
    assert manifest.clock.rule == "recorded"
    for stream in manifest.streams[:3]:
        with open_images(session, stream.name) as images:
            assert len(images) == stream.n_frames == len(recording.times[stream.name])
            assert images.t_ns is not None
            assert (images.t_ns == recording.times[stream.name]).all()
            camera, point = recording.renderer.cameras[stream.name], np.array([0.1, 0.2, 1.5])
            assert images.camera is not None
            assert images.camera.project(point) == pytest.approx(camera.project(point))


def test_depth_is_kept_as_rendered_and_colour_nearly(session: Session, recording: Recording) -> None:
    frames = {name: moments(recording.renderer, t_ns) for name, t_ns in recording.times.items()}
    with open_images(session, "depth") as images:
        assert images.unit_m == 0.001
        for index, image in zip((0, 31), images.read((0, 31)), strict=True):
            assert (image == recording.renderer.depth(frames["depth"][index])).all()
    for name in ("color", "color2"):
        with open_images(session, name) as images:
            for index, image in zip((2, 65), images.read((2, 65)), strict=True):
                made = recording.renderer.color(frames[name][index], name)
                assert cv2.PSNR(image, made) > 30


def test_every_stream_has_a_trembling_clock_of_its_own(session: Session, recording: Recording) -> None:
    frames = session.table("frames").to_pandas()
    assert frames["t_ns"].is_monotonic_increasing
    for name, every in (("color", 1), ("color2", 1), ("depth", 2)):
        t_ns = frames.loc[frames["stream"] == name, "t_ns"].to_numpy()
        assert (t_ns == recording.times[name]).all()
        even = recording.truth.t_ns[::every]
        tremble = t_ns[1:] - even[1:]
        assert 150_000 < tremble.std() < 450_000
        assert (0 if name == "color" else 1_500_000) <= t_ns[0] < 15_500_000
        assert (np.diff(t_ns) > 20_000_000 * every).all()


def test_nothing_that_perception_should_find_is_in_the_session(
    session: Session, recording: Recording
) -> None:
    assert {table.name for table in session.manifest.tables}.isdisjoint({"markers_2d", "markers_3d", "poses"})
    assert session.manifest.prototypes == tuple(box.to_dict() for box in recording.truth.prototypes)


def test_annotated_times_are_those_of_the_recorded_clock(session: Session, recording: Recording) -> None:
    t_ns = recording.times["color"]
    layer = session.layer()
    assert layer.events
    for event in layer.events:
        for segment in event.segments:
            assert segment.start_ns == t_ns[segment.start_frame]
    for thing in layer.objects:
        assert all(key.t_ns == t_ns[key.frame] for key in thing.key_frames)


def test_there_is_a_beep_where_an_event_begins(session: Session, recording: Recording) -> None:
    with wave.open(str(session.stream_path("audio")), "rb") as file:
        assert (file.getnchannels(), file.getframerate(), file.getsampwidth()) == (1, SOUND_HZ, 2)
        heard = np.frombuffer(file.readframes(file.getnframes()), "<i2")
    assert (heard == sound(recording.truth)).all()
    loud = np.flatnonzero(heard)
    begins = recording.truth.t_ns[recording.truth.moves[0].carries[0].grasp] / 1e9
    assert loud[0] / SOUND_HZ == pytest.approx(begins, abs=0.001)
    assert (loud[-1] - loud[0]) / SOUND_HZ == pytest.approx(BEEP_S, abs=0.001)
    beep = heard[loud[0] : loud[-1]].astype(float)
    assert np.argmax(np.abs(np.fft.rfft(beep, SOUND_HZ))) == pytest.approx(BEEP_HZ, abs=5)


def test_the_truth_tells_every_image(recording: Recording) -> None:
    times = {name: t_ns[60:64] for name, t_ns in recording.times.items()}
    tables = Recording(recording.draft, recording.truth, recording.renderer, times).image_truth()
    poses, faces, cameras = (tables[name].to_pylist() for name in ("image_poses", "image_faces", "cameras"))
    assert len(poses) == 3 * 4 * 2
    assert len(faces) == 3 * 4 * 6
    scene, renderer = recording.truth.scene, recording.renderer
    for row in faces:
        frame = moments(renderer, np.array([row["t_ns"]]))[0]
        box = recording.truth.object_ids.index(row["object_id"])
        nearest = recording.truth.corners[box, round(frame)]
        names = [face.face for face in recording.truth.prototypes[box].faces]
        camera = renderer.cameras[row["stream"]]
        pixels = camera.project(scene.depth_from_table.apply(nearest[names.index(row["face"])]))
        assert (row["u0_px"], row["v0_px"]) == pytest.approx(pixels[0], abs=3)
        assert 0 <= row["visible"] <= 1
        assert row["visible"] == 0 or row["tilt_rad"] < np.pi / 2
    assert {row["camera"] for row in cameras} == {"color", "color2", "depth"}


@pytest.mark.parametrize("size", [(481, 270), (8, 8), (20_000, 100)])
def test_impossible_sizes_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(UsageError, match="sample"):
        sample_recording(seed=0, actions=["next"], size=size)


def test_the_unmirrored_session_has_unmirrored_cameras() -> None:
    made = sample_recording(seed=4, actions=["toward"], size=SIZE, mirrored=False)
    assert not any(camera.mirrored for camera in made.draft.manifest.cameras)
    assert not made.truth.scene.color.mirrored


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--cameras", "2"], "add --pixels"),
        (["--pixels", "--size", "large"], "--size large"),
        (["--pixels", "--size", "41x30"], "41 x 30"),
    ],
)
def test_the_command_refuses_impossible_images(
    options: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sample", str(tmp_path / "made"), *options]) == 2
    assert told in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
