"""Recordings of an Azure Kinect: images and times as recorded, cameras by mode, and what a damaged file still holds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.check import check
from ecat.errors import EcatError, FormatError
from ecat.formats import import_source, registry
from ecat.formats.recordings.azure_mkv import SAMPLE, imu_rows
from ecat.formats.recordings.k4a_calibration import cameras_of
from ecat.geometry.records import camera_of
from ecat.store import Session, open_session, validate
from ecat.store.media import open_images
from tests.formats.recordings.k4a import (
    PERIOD_US,
    START_OFFSET_NS,
    calibration,
    depth,
    imu_sample,
    jpeg,
    recording,
    write,
)

N = 6


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound recording."""
    return write(tmp_path_factory.mktemp("k4a") / "recording.mkv", recording(N))


@pytest.fixture(scope="module")
def session(source: Path) -> Session:
    """It, imported."""
    return open_session(import_source(source, source.parent / "session").path)


def test_it_is_told_by_its_content(source: Path, tmp_path: Path) -> None:
    assert registry.sniff(source).name == "azure-mkv"
    other = tmp_path / "other.mkv"
    other.write_bytes(source.read_bytes())
    assert registry.sniff(other).name == "azure-mkv"


def test_depth_and_infrared_are_as_recorded(session: Session) -> None:
    images = open_images(session, "depth")
    assert images.unit_m == 0.001
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image, depth(i))
    for i, image in enumerate(open_images(session, "infrared")):
        np.testing.assert_array_equal(image, depth(i) // 2)


def test_color_looks_as_recorded(session: Session) -> None:
    for i, image in enumerate(open_images(session, "color")):
        recorded = cv2.imdecode(np.frombuffer(jpeg(i), np.uint8), cv2.IMREAD_COLOR)
        assert recorded is not None
        assert cv2.PSNR(np.asarray(recorded), np.ascontiguousarray(image)) > 30
        assert np.abs(image.reshape(-1, 3).mean(0) - recorded.reshape(-1, 3).mean(0)).max() < 2


def test_every_stream_keeps_its_device_times(session: Session) -> None:
    for name in ("color", "depth", "infrared"):
        t_ns = open_images(session, name).t_ns
        np.testing.assert_array_equal(t_ns, 1000 * (10_000 + PERIOD_US * np.arange(N)))
    assert session.manifest.n_frames == N
    assert session.manifest.clock.rule == "recorded"


def test_inertial_samples_count_from_the_start_of_the_recording(session: Session) -> None:
    rows = session.table("imu").to_pandas()
    assert len(rows) == 2 * N
    accelerometer = rows[rows["sensor"] == "accelerometer"]
    np.testing.assert_array_equal(accelerometer["t_ns"], 1000 * (10_000 + PERIOD_US * np.arange(N)))
    np.testing.assert_array_equal(accelerometer["y"], np.arange(N))
    assert (accelerometer["z"] == -9.8125).all()
    assert (rows[rows["sensor"] == "gyroscope"]["x"] == 0.25).all()


def test_tags_are_kept_and_the_session_is_sound(session: Session) -> None:
    assert session.manifest.foreign["azure-mkv:K4A_START_OFFSET_NS"] == str(START_OFFSET_NS)
    assert validate(session, deep=True) == []
    assert [finding for finding in check(session.path) if finding.severity == "error"] == []
    assert session.manifest.provenance.notes == (
        "stream color: transcoded from mjpeg to H.264, which browsers play",
    )


@pytest.mark.parametrize(("fourcc", "bits"), [(b"NV12", 12), (b"YUY2", 16), (b"BGRA", 32)])
def test_other_color_formats(tmp_path: Path, fourcc: bytes, bits: int) -> None:
    plain = {
        b"NV12": lambda n: bytes([150]) * (n * 8 // 12) + bytes([100, 170]) * (n * 4 // 24),
        b"YUY2": lambda n: bytes([150, 100, 150, 170]) * (n // 4),
        b"BGRA": lambda n: bytes([30, 120, 200, 255]) * (n // 4),
    }[fourcc](640 * 480 * bits // 8)
    made = recording(2, fourcc=fourcc, color=[plain] * 2, color_px=(640, 480))
    session = open_session(import_source(write(tmp_path / "r.mkv", made), tmp_path / "s").path)
    image = next(iter(open_images(session, "color")))
    expected = (30, 120, 200) if fourcc == b"BGRA" else image[0, 0]
    assert np.abs(image.astype(int) - np.array(expected, int)).max() <= 6
    if fourcc != b"BGRA":
        luma = next(iter(open_images(session, "color", gray=True)))
        assert abs(int(luma[100, 100]) - 150) <= 1


# --- cameras


@pytest.mark.parametrize(
    ("color_px", "cy"),
    [
        ((1280, 720), 359.5),
        ((1920, 1080), 539.5),
        ((2560, 1440), 719.5),
        ((2048, 1536), 767.5),
        ((4096, 3072), 1535.5),
    ],
)
def test_color_modes_scale_and_cut_the_same_calibration(color_px: tuple[int, int], cy: float) -> None:
    (color,), problems = cameras_of(calibration(), color_px=color_px, depth_px=None)
    assert problems == []
    assert (color.width_px, color.height_px) == color_px
    assert color.fx_px == color.fy_px == color_px[0] / 2
    assert (color.cx_px, color.cy_px) == (color_px[0] / 2 - 0.5, cy)
    assert color.distortion == (0.5, -2.5, 0.001, 0.002, 1.5, 0.25, -2.25, 1.25)


def test_an_early_16_to_9_calibration_gives_the_same_camera() -> None:
    old, new = (
        cameras_of(calibration(s), color_px=(1920, 1080), depth_px=None)[0]
        for s in ((4096, 2304), (4096, 3072))
    )
    assert old[0].cy_px == pytest.approx(new[0].cy_px)
    assert old[0].fy_px == pytest.approx(new[0].fy_px)


@pytest.mark.parametrize(
    ("depth_px", "f", "centre"),
    [
        ((640, 576), 512, (512 - 192 - 0.5, 512 - 180 - 0.5)),
        ((320, 288), 256, (256 - 96 - 0.5, 256 - 90 - 0.5)),
        ((1024, 1024), 512, (511.5, 511.5)),
        ((512, 512), 256, (255.5, 255.5)),
    ],
)
def test_depth_modes_cut_the_sensor(depth_px: tuple[int, int], f: float, centre: tuple[float, float]) -> None:
    (camera,), _ = cameras_of(calibration(), color_px=None, depth_px=depth_px)
    assert (camera.fx_px, camera.fy_px) == (f, f)
    assert (camera.cx_px, camera.cy_px) == centre


def test_points_of_the_depth_camera_are_seen_by_the_color_camera_beside_it(session: Session) -> None:
    record = session.manifest.camera("color")
    assert record is not None
    assert record.reference == "depth"
    camera = camera_of(record)
    # a point 32 mm to the right of the depth camera's axis is straight ahead of the colour camera
    np.testing.assert_allclose(camera.project(np.array([0.032, 0.0, 1.0])), [639.5, 359.5], atol=1e-6)


def broken(**changes: Any) -> dict[str, Any]:
    document = calibration()
    document["CalibrationInformation"]["Cameras"][1] |= changes
    return document


@pytest.mark.parametrize(
    "document",
    [
        None,
        [],
        {"CalibrationInformation": {"Cameras": [5, None]}},
        broken(Intrinsics={}),
        broken(SensorWidth="x"),
        broken(SensorWidth=1000),
        broken(Rt={"Rotation": [1] * 9, "Translation": [0, 0, 0]}),
        broken(Rt={"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": [0, 0, 1e400]}),
        broken(Intrinsics={"ModelType": "Fisheye", "ModelParameters": [0] * 14}),
    ],
)
def test_a_calibration_without_sense_is_left_out_and_said_so(document: Any) -> None:
    cameras, problems = cameras_of(document, color_px=(1280, 720), depth_px=None)
    assert cameras == ()
    assert len(problems) == 1


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
)


@given(json_values, st.sampled_from(["Intrinsics", "Rt", "SensorWidth", "SensorHeight", "Location"]))
def test_any_value_anywhere_in_the_calibration_is_survived(value: Any, key: str) -> None:
    cameras, problems = cameras_of(broken(**{key: value}), color_px=(1280, 720), depth_px=(640, 576))
    assert len(cameras) == 2 or problems


def test_an_attachment_too_large_for_a_calibration_costs_the_cameras_and_not_the_images(
    tmp_path: Path,
) -> None:
    large = b"{" + b" " * (1 << 20) + b"}"
    report = import_source(write(tmp_path / "r.mkv", recording(2, calibration=large)), tmp_path / "s")
    session = open_session(report.path)
    assert (len(open_images(session, "color")), session.manifest.cameras) == (2, ())
    assert any("1,048,578 bytes, more than 1,048,576" in finding for finding in report.findings)


def test_a_recording_without_calibration_has_images_and_no_cameras(tmp_path: Path) -> None:
    report = import_source(write(tmp_path / "r.mkv", recording(2, calibration=None)), tmp_path / "s")
    assert open_session(report.path).manifest.cameras == ()
    assert any("no calibration" in finding for finding in report.findings)
    assert open_images(open_session(report.path), "depth").camera is None


@pytest.mark.parametrize("content", [b"{", b"\xff\xfe\x00", b"[" * 100_000, b"3"])
def test_a_damaged_calibration_does_not_cost_the_images(tmp_path: Path, content: bytes) -> None:
    report = import_source(write(tmp_path / "r.mkv", recording(2, calibration=content)), tmp_path / "s")
    assert open_session(report.path).manifest.n_frames == 2
    assert any("calibration" in finding for finding in report.findings)


# --- what is missing, and what is damaged


def test_missing_tags_are_named(tmp_path: Path) -> None:
    report = import_source(write(tmp_path / "r.mkv", recording(2, tags=False)), tmp_path / "s")
    assert any("lacks the tags K4A_DEPTH_DELAY_NS" in finding for finding in report.findings)


@pytest.mark.parametrize(("lacking", "kept"), [("color", "depth"), ("depth", "color")])
def test_one_camera_alone_is_a_session(tmp_path: Path, lacking: str, kept: str) -> None:
    report = import_source(write(tmp_path / "r.mkv", recording(3, **{lacking: []})), tmp_path / "s")
    session = open_session(report.path)
    assert session.manifest.n_frames == 3
    assert len(open_images(session, kept)) == 3
    assert any(f"no {lacking} track" in finding for finding in report.findings)


def test_clock_jumps_are_imported_and_found_by_check(tmp_path: Path) -> None:
    times = [0, 33_333, 66_666, 50_000, 50_000, 166_665]
    made = replace(recording(6, infrared=False, imu=False), times_us=times)
    session = open_session(import_source(write(tmp_path / "r.mkv", made), tmp_path / "s").path)
    images = open_images(session, "depth")
    assert len(images) == 6
    np.testing.assert_array_equal(images.t_ns, np.array(times) * 1000)
    assert sum(1 for _ in images) == 6
    assert "clock-backwards" in {finding.code for finding in check(session.path)}


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 0.999])
def test_a_truncated_recording_gives_what_it_holds(tmp_path: Path, source: Path, share: float) -> None:
    data = source.read_bytes()
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(data[: int(len(data) * share)])
    report = import_source(cut, tmp_path / "s")
    session = open_session(report.path)
    n = session.manifest.n_frames
    assert 0 < n <= N
    assert any("not complete" in finding and "too early" in finding for finding in report.findings)
    assert session.manifest.provenance.notes == report.findings
    for i, image in enumerate(open_images(session, "depth")):
        np.testing.assert_array_equal(image, depth(i))


def test_an_undecodable_image_is_left_out_and_its_neighbours_stay(tmp_path: Path) -> None:
    color = [jpeg(0), b"no picture at all", jpeg(2)]
    report = import_source(write(tmp_path / "r.mkv", recording(3, color=color)), tmp_path / "s")
    session = open_session(report.path)
    t_ns = open_images(session, "color").t_ns
    np.testing.assert_array_equal(t_ns, [10_000_000, 1000 * (10_000 + 2 * PERIOD_US)])
    assert sum(1 for _ in open_images(session, "color")) == 2
    assert any("1 images could not be decoded" in finding for finding in report.findings)


def test_nothing_decodable_is_an_error_and_leaves_nothing(tmp_path: Path, source: Path) -> None:
    for name, data in {
        "head": source.read_bytes()[:6000],
        "empty": b"",
        "noise": b"\x1a\x45\xdf\xa3K4A_" * 99,
    }.items():
        file = tmp_path / f"{name}.mkv"
        file.write_bytes(data)
        with pytest.raises(FormatError):
            import_source(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@settings(max_examples=25)
@given(st.data())
def test_damage_anywhere_ends_in_a_session_or_a_typed_error(
    tmp_path_factory: pytest.TempPathFactory, source: Path, data: st.DataObject
) -> None:
    content = bytearray(source.read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        at = data.draw(st.integers(0, 8000) | st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    folder = tmp_path_factory.mktemp("damage")
    (folder / "r.mkv").write_bytes(content)
    try:
        report = import_source(folder / "r.mkv", folder / "s", format="azure-mkv")
    except EcatError:
        assert not (folder / "s").exists()
    else:
        for stream in open_session(report.path).manifest.streams:
            assert sum(1 for _ in open_images(open_session(report.path), stream.name)) == stream.n_frames


@given(st.integers(0, 50), st.integers(0, 2**40), st.integers(0, 2**63))
def test_inertial_rows_are_sorted_and_complete(n: int, first: int, wild: int) -> None:
    raw = b"".join(imu_sample(first + 1000 * ((7 * i) % max(n, 1)), i) for i in range(n)) + imu_sample(
        wild, 0
    )
    batches = list(imu_rows(np.frombuffer(raw, SAMPLE), first))
    t_ns = np.concatenate([np.asarray(batch["t_ns"]) for batch in batches] or [np.zeros(0, np.int64)])
    assert (np.diff(t_ns) >= 0).all()
    assert len(t_ns) in {2 * n, 2 * n + 1, 2 * n + 2}


# --- the real one


def test_the_real_recording(shared: Path, tmp_path: Path) -> None:
    folder = shared / "azure_kinect"
    report = import_source(folder / "recording.mkv", tmp_path / "s")
    session = open_session(report.path)
    assert [stream.n_frames for stream in session.manifest.streams] == [1, 1, 1]
    color, depth_camera = session.manifest.cameras
    assert color.fx_px == pytest.approx(611.8, abs=0.1)
    assert depth_camera.fx_px == pytest.approx(504.6, abs=0.1)
    # the sensor's documented baseline: 32 mm, tilted against each other by 4 to 6 degrees
    assert color.translation_m[0] == pytest.approx(0.0321, abs=2e-4)
    assert np.degrees(2 * np.arcsin(np.linalg.norm(color.rotation[:3]))) == pytest.approx(4.94, abs=0.1)
    beside = json.loads((folder / "calibration.json").read_text())
    assert cameras_of(beside, color_px=(1280, 720), depth_px=(640, 576))[0] == session.manifest.cameras
    gravity = session.table("imu").to_pandas().query("sensor == 'accelerometer'")[["x", "y", "z"]].to_numpy()
    assert np.linalg.norm(gravity) == pytest.approx(9.81, abs=0.3)
    image = next(iter(open_images(session, "depth")))
    assert image.shape == (576, 640)
    assert 500 < np.median(image[image > 0]) < 3000
