"""A folder of a colour and a depth video: each keeps its times and what it measured, the cameras come from a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.check import check
from ecat.errors import EcatError, FormatError
from ecat.formats import import_source, registry
from ecat.formats.recordings.ecat_recorder import FORMAT as ECAT_RECORDER
from ecat.geometry.records import camera_of
from ecat.store import Session, open_session, validate
from ecat.store.media import open_images
from tests.store.media.clips import PERIOD_NS, color_clip, color_image, depth_clip, depth_image, number_of

N = 8
PINHOLE = {"fx": 50.0, "fy": 51.0, "cx": 30.5, "cy": 20.5}
CALIBRATION: dict[str, Any] = {
    "depth_unit_m": 0.0005,
    "color": {**PINHOLE, "rotation": [0, 0, 0, 1], "translation_m": [0.05, 0, 0]},
    "depth": {**PINHOLE, "cx": 16.5, "cy": 11.5},
}


def folder(path: Path, *, color: bool = True, depth: bool = True, camera: object = CALIBRATION) -> Path:
    """A recording as a camera's own programs can be made to write it."""
    path.mkdir()
    if color:
        color_clip(path / "color.mp4", N)
    if depth:
        depth_clip(path / "depth.mkv", N)
    if camera is not None:
        (path / "camera.json").write_text(camera if isinstance(camera, str) else json.dumps(camera))
    return path


def encoded(
    path: Path,
    images: Sequence[np.ndarray],
    codec: str,
    pix_fmt: str,
    *,
    source_fmt: str = "gray16le",
    options: dict[str, str] | None = None,
) -> Path:
    """A video as another program would write it."""
    import av

    with av.open(str(path), "w") as out:
        stream: Any = out.add_stream(codec, rate=30, options=options or {})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pix_fmt
        for i, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format=source_fmt).reformat(format=pix_fmt)
            frame.pts, frame.time_base = i, Fraction(1, 30)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def imported(source: Path) -> Session:
    return open_session(import_source(source, source.parent / f"{source.name}_session").path)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound recording."""
    return folder(tmp_path_factory.mktemp("rgbd") / "recording")


@pytest.fixture(scope="module")
def session(source: Path) -> Session:
    """It, imported."""
    return imported(source)


def test_it_is_told_by_the_names_in_the_folder(source: Path, tmp_path: Path) -> None:
    assert registry.sniff(source).name == "rgbd-video"
    other = tmp_path / "other"
    other.mkdir()
    color_clip(other / "RGB.MKV", 2)
    assert registry.sniff(other).name == "rgbd-video"
    (other / "preview.png").write_bytes(b"")
    assert registry.sniff(other).name == "rgbd-video"


def test_what_is_no_folder_is_an_error_that_says_so(source: Path, tmp_path: Path) -> None:
    with pytest.raises(EcatError, match=r"cannot import color\.mp4"):
        import_source(source / "color.mp4", tmp_path / "s", format="rgbd-video")


def test_what_the_recorder_of_2015_wrote_is_not_taken_for_one(source: Path) -> None:
    assert ECAT_RECORDER.sniff is not None
    assert not ECAT_RECORDER.sniff(source)


def test_files_that_are_fit_are_kept_to_the_last_byte(source: Path, session: Session) -> None:
    for name in ("color.mp4", "depth.mkv"):
        kept = session.stream_path(name.partition(".")[0])
        assert kept.read_bytes() == (source / name).read_bytes()
    assert session.manifest.provenance.notes == ()
    assert [number_of(image) for image in open_images(session, "color")] == list(range(N))
    for i, image in enumerate(open_images(session, "depth")):
        np.testing.assert_array_equal(image, depth_image(i))


def test_the_session_is_sound(session: Session) -> None:
    assert session.manifest.n_frames == N
    assert validate(session, deep=True) == []
    assert [finding for finding in check(session.path) if finding.severity == "error"] == []


# --- times


def test_every_video_keeps_its_own_times(session: Session) -> None:
    for name in ("color", "depth"):
        t_ns = open_images(session, name).t_ns
        assert t_ns is not None
        assert np.abs(t_ns - np.arange(N) * PERIOD_NS).max() <= 1000


def test_a_camera_that_starts_late_starts_late(tmp_path: Path) -> None:
    source = folder(tmp_path / "r", color=False)
    late = [500_000_000 + i * PERIOD_NS for i in range(N)]
    color_clip(source / "color.mkv", N, late)
    session = imported(source)
    first = {name: open_images(session, name).t_ns for name in ("color", "depth")}
    assert first["depth"] is not None
    assert first["color"] is not None
    assert first["depth"][0] == 0
    assert abs(int(first["color"][0]) - 500_000_000) <= 1000


@settings(max_examples=15)
@given(st.lists(st.integers(1_000_000, 10**10), min_size=1, max_size=12))
def test_uneven_times_are_kept(tmp_path_factory: pytest.TempPathFactory, steps: list[int]) -> None:
    times = np.cumsum([0, *steps]) // 1000 * 1000
    source = tmp_path_factory.mktemp("times") / "r"
    source.mkdir()
    color_clip(source / "color.mkv", len(times), times.tolist())
    t_ns = open_images(imported(source), "color").t_ns
    np.testing.assert_array_equal(t_ns, times)


# --- one without the other


@pytest.mark.parametrize(
    ("kept", "told"), [("color", "there is no depth video"), ("depth", "there is no colour video")]
)
def test_a_video_that_is_not_there_is_missed(tmp_path: Path, kept: str, told: str) -> None:
    report = import_source(
        folder(tmp_path / "in", color=kept == "color", depth=kept == "depth"), tmp_path / "s"
    )
    assert [finding for finding in report.findings if finding.startswith("there is no")] == [told]


def test_color_alone_is_a_session(tmp_path: Path) -> None:
    session = imported(folder(tmp_path / "r", depth=False))
    assert [stream.name for stream in session.manifest.streams] == ["color"]
    (camera,) = session.manifest.cameras
    assert (camera.name, camera.reference) == ("color", "")


def test_depth_alone_is_a_session_whose_frames_are_its_images(tmp_path: Path) -> None:
    session = imported(folder(tmp_path / "r", color=False))
    assert [stream.name for stream in session.manifest.streams] == ["depth"]
    assert session.manifest.n_frames == N
    assert len(list(open_images(session, "depth"))) == N


def test_sound_comes_along_and_other_videos_are_named(tmp_path: Path) -> None:
    source = folder(tmp_path / "r")
    (source / "audio.wav").write_bytes(b"RIFF\x04\0\0\0WAVE")
    color_clip(source / "selfie.mp4", 2)
    session = imported(source)
    assert session.stream_path("audio").read_bytes() == (source / "audio.wav").read_bytes()
    assert session.manifest.provenance.notes == ("selfie.mp4 was not imported",)


# --- depth


@pytest.mark.parametrize(
    ("name", "codec", "pix_fmt", "options"),
    [
        ("depth.mov", "png", "gray16be", {}),
        ("depth.avi", "ffv1", "gray16le", {}),
        ("depth.mkv", "ffv1", "gray16le", {"g": "4"}),
    ],
)
def test_other_depth_without_loss_is_encoded_anew_to_the_last_bit(
    tmp_path: Path, name: str, codec: str, pix_fmt: str, options: dict[str, str]
) -> None:
    source = folder(tmp_path / "r", depth=False)
    encoded(source / name, [depth_image(i) for i in range(N)], codec, pix_fmt, options=options)
    session = imported(source)
    assert session.stream("depth").codec == "ffv1 gray16le"
    for i, image in enumerate(open_images(session, "depth")):
        np.testing.assert_array_equal(image, depth_image(i))


@pytest.mark.parametrize(("pix_fmt", "most"), [("gray10le", 1023), ("gray12le", 4095)])
def test_depth_of_fewer_bits_keeps_its_numbers(tmp_path: Path, pix_fmt: str, most: int) -> None:
    source = folder(tmp_path / "r", depth=False)
    images = [depth_image(i) % (most + 1) for i in range(N)]
    encoded(source / "depth.mkv", images, "ffv1", pix_fmt, source_fmt=pix_fmt)
    for i, image in enumerate(open_images(imported(source), "depth")):
        np.testing.assert_array_equal(image, images[i])


@pytest.mark.parametrize(
    ("codec", "pix_fmt"), [("ffv1", "gray"), ("libx264", "yuv420p"), ("mjpeg", "yuvj420p")]
)
def test_depth_that_lost_its_16_bits_is_refused(tmp_path: Path, codec: str, pix_fmt: str) -> None:
    source = folder(tmp_path / "r", depth=False)
    encoded(source / "depth.mkv", [color_image(i) for i in range(2)], codec, pix_fmt, source_fmt="bgr24")
    with pytest.raises(FormatError, match="cannot import") as caught:
        import_source(source, tmp_path / "s")
    assert pix_fmt in caught.value.where
    assert "gray16le" in caught.value.fix
    assert not (tmp_path / "s").exists()


def test_units_are_those_of_the_file_or_taken_for_millimetres_and_said_so(
    tmp_path: Path, session: Session
) -> None:
    assert session.stream("depth").depth_unit_m == 0.0005
    without = imported(folder(tmp_path / "r", camera=CALIBRATION | {"depth_unit_m": None}))
    assert without.stream("depth").depth_unit_m == 0.001
    assert any("taken for millimetres" in note for note in without.manifest.provenance.notes)


# --- cameras


def test_cameras_are_those_of_the_file(session: Session) -> None:
    color, depth = session.manifest.cameras
    assert (color.fx_px, color.fy_px, color.cx_px, color.cy_px) == (50.0, 51.0, 30.5, 20.5)
    assert color.reference == "depth"
    assert color.translation_m == (0.05, 0, 0)
    assert (depth.cx_px, depth.reference) == (16.5, "")
    assert [session.stream(name).camera for name in ("color", "depth")] == ["color", "depth"]


def test_a_mirrored_camera_sees_the_right_side_of_the_world_on_the_left(tmp_path: Path) -> None:
    camera = CALIBRATION | {name: CALIBRATION[name] | {"mirrored": True} for name in ("color", "depth")}
    session = imported(folder(tmp_path / "r", camera=camera))
    assert all(record.mirrored for record in session.manifest.cameras)
    depth = camera_of(session.manifest.cameras[1])
    to_the_right, ahead = depth.project(np.array([[0.1, 0, 1.0], [0, 0, 1.0]]))[:, 0]
    assert to_the_right < ahead


def test_a_calibration_of_another_size_is_scaled(tmp_path: Path) -> None:
    camera = {"color": {**PINHOLE, "width": 128, "height": 96}}
    (record,) = imported(folder(tmp_path / "r", depth=False, camera=camera)).manifest.cameras
    assert (record.width_px, record.height_px, record.fx_px, record.cx_px) == (64, 48, 25.0, 15.0)


def test_without_a_file_the_cameras_are_unknown_and_it_is_said_how_to_tell_them(tmp_path: Path) -> None:
    session = imported(folder(tmp_path / "r", camera=None))
    assert session.manifest.cameras == ()
    assert any("write camera.json" in note for note in session.manifest.provenance.notes)


@pytest.mark.parametrize(
    "content",
    ["", "{", "[" * 100_000, "3", '{"color": 7, "depth": null}', '{"color": {"fx": "wide"}}', '{"fx": NaN}'],
)
def test_a_bad_calibration_costs_the_cameras_and_not_the_images(tmp_path: Path, content: str) -> None:
    session = imported(folder(tmp_path / "r", camera=content))
    assert session.manifest.cameras == ()
    assert session.manifest.n_frames == N
    assert any("unknown" in note for note in session.manifest.provenance.notes)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
)


@settings(max_examples=20)
@given(json_values, st.sampled_from([*PINHOLE, "rotation", "translation_m", "distortion", "width"]))
def test_any_value_anywhere_in_the_calibration_ends_in_a_session(
    tmp_path_factory: pytest.TempPathFactory, value: Any, key: str
) -> None:
    camera = CALIBRATION | {"color": CALIBRATION["color"] | {key: value}}
    session = imported(folder(tmp_path_factory.mktemp("json") / "r", camera=camera))
    assert session.manifest.n_frames == N
    assert validate(session) == []


# --- damage


@pytest.mark.parametrize("name", ["color.mp4", "depth.mkv"])
@pytest.mark.parametrize("content", [b"", b"x" * 1000])
def test_a_video_that_is_none_is_left_out_and_the_other_saved(
    tmp_path: Path, name: str, content: bytes
) -> None:
    source = folder(tmp_path / "r")
    (source / name).write_bytes(content)
    session = imported(source)
    assert [s.name for s in session.manifest.streams if s.kind in {"color", "depth"}] == [
        "depth" if name == "color.mp4" else "color"
    ]
    assert any(name in note for note in session.manifest.provenance.notes)


def test_videos_that_are_none_are_a_format_error(tmp_path: Path) -> None:
    source = folder(tmp_path / "r")
    for name in ("color.mp4", "depth.mkv"):
        (source / name).write_bytes(b"x" * 1000)
    with pytest.raises(FormatError, match="cannot import") as caught:
        import_source(source, tmp_path / "s")
    assert "color.mp4" in caught.value.where
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_truncated_depth_video_gives_what_it_holds(tmp_path: Path, share: float) -> None:
    source = folder(tmp_path / "r")
    data = (source / "depth.mkv").read_bytes()
    (source / "depth.mkv").write_bytes(data[: int(len(data) * share)])
    session = imported(source)
    images = list(open_images(session, "depth"))
    assert 0 < len(images) < N
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image, depth_image(i))
    assert any("not complete" in note for note in session.manifest.provenance.notes)
    assert session.manifest.n_frames == N


@settings(max_examples=20)
@given(st.data())
def test_damage_anywhere_ends_in_a_session_or_a_typed_error(
    tmp_path_factory: pytest.TempPathFactory, source: Path, data: st.DataObject
) -> None:
    hurt = tmp_path_factory.mktemp("damage") / "r"
    hurt.mkdir()
    name = data.draw(st.sampled_from(["color.mp4", "depth.mkv"]))
    for path in source.iterdir():
        content = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 8)) if path.name == name else 0):
            at = data.draw(st.integers(0, min(2000, len(content) - 1)) | st.integers(0, len(content) - 1))
            content[at] = data.draw(st.integers(0, 255))
        (hurt / path.name).write_bytes(content)
    try:
        report = import_source(hurt, hurt.parent / "s", format="rgbd-video")
    except EcatError:
        assert not (hurt.parent / "s").exists()
    else:
        assert open_session(report.path).manifest.streams
