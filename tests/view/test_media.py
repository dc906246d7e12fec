"""Images of a session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from rerun.chunk import Chunk

from ecat.formats.ecat2018.depth_file import write_depth_file
from ecat.model import Camera, Manifest, Stream
from ecat.progress import silent
from ecat.store import Draft, Session, TableData, create_session
from ecat.view.media import image_frames, media, reduced
from ecat.view.scene import scene
from ecat.view.space import cameras
from tests.view.chunks import at, table
from tests.view.conftest import draft

IMAGE, DEPTH = "/world/camera/color/image", "/world/camera/depth"


def with_stream(tmp_path: Path, source: Path, stream: Stream, frames: pa.Table | None = None) -> Session:
    small = draft()
    stream = replace(stream, file=f"media/{source.name}", present=True)
    tables = dict(small.tables) | ({"frames": TableData(data=frames)} if frames is not None else {})
    manifest = replace(small.manifest, streams=(stream,))
    return create_session(
        tmp_path / "s",
        Draft(manifest=manifest, layers=small.layers, tables=tables, files={stream.name: source}),
    )


def video(file: Path, images: list[NDArray[np.uint8]]) -> Path:
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 30, (width, height))
    for image in images:
        writer.write(image)
    writer.release()
    return file


def sent(session: Session) -> list[Chunk]:
    return list(media(session, scene(session), silent))


def decoded(blob: list[bytes] | list[list[int]]) -> NDArray[np.generic]:
    found = cv2.imdecode(np.frombuffer(bytes(blob[0]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert found is not None
    return np.asarray(found)


def test_wide_images_are_reduced_and_drawn_at_their_full_size(tmp_path: Path) -> None:
    images = [np.full((108, 1920, 3), 40 * i, np.uint8) for i in range(3)]
    session = with_stream(
        tmp_path, video(tmp_path / "c.avi", images), Stream(name="color", kind="color", n_frames=3)
    )
    chunks = sent(session)
    blobs = at(chunks, IMAGE, "blob")
    assert list(blobs) == [0, 1, 2]
    assert [decoded(blob).shape for blob in blobs.values()] == [(54, 960, 3)] * 3
    assert [round(float(decoded(blob).mean(dtype=float)) / 40) for blob in blobs.values()] == [0, 1, 2]
    assert at(chunks, IMAGE, "scale")[None] == [[2, 2, 1]]


def test_images_after_the_last_frame_are_not_shown(tmp_path: Path) -> None:
    images = [np.zeros((48, 64, 3), np.uint8)] * 9
    session = with_stream(
        tmp_path, video(tmp_path / "c.avi", images), Stream(name="color", kind="color", n_frames=9)
    )
    assert list(at(sent(session), IMAGE, "blob")) == list(range(session.manifest.n_frames))


@pytest.mark.parametrize("kind", ["color", "depth"])
def test_what_cannot_be_decoded_is_said_in_the_log(tmp_path: Path, kind: str) -> None:
    (tmp_path / "broken.mkv").write_bytes(b"no video at all")
    stream = Stream(name=kind, kind="color" if kind == "color" else "depth", n_frames=3)
    chunks = sent(with_stream(tmp_path, tmp_path / "broken.mkv", stream))
    assert "could not be decoded" in at(chunks, "/log/media", "text")[None][0]


@pytest.mark.parametrize("name", ["d.mkv", "d.dep"])
def test_depth_is_shown_in_millimetres_at_half_resolution(tmp_path: Path, name: str) -> None:
    images = [np.arange(48 * 64, dtype=np.uint16).reshape(48, 64) + 1000 * i for i in range(3)]
    file = tmp_path / name
    if name == "d.dep":
        write_depth_file(file, enumerate(images))
    else:
        options = [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U, cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
        writer = cv2.VideoWriter(
            str(file), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 30, (64, 48), options
        )
        for image in images:
            writer.write(image)
        writer.release()
    chunks = sent(with_stream(tmp_path, file, Stream(name="depth", kind="depth", n_frames=3)))
    shown = at(chunks, DEPTH, "blob")
    # three images over six frames
    assert list(shown) == [0, 2, 4]
    for blob, image in zip(shown.values(), images, strict=True):
        assert np.array_equal(decoded(blob), image[::2, ::2])
    assert at(chunks, DEPTH, "meter")[None] == [1000]


def test_the_depth_camera_is_as_reduced_as_its_images() -> None:
    camera = Camera(name="depth", width_px=64, height_px=48, fx_px=50, fy_px=50, cx_px=32, cy_px=24)
    stream = Stream(name="depth", kind="depth", camera="depth", present=True)
    manifest = Manifest(name="s", created="2024-01-01T00:00:00", cameras=(camera,), streams=(stream,))
    assert at(list(cameras(manifest)), DEPTH, "resolution")[None] == [[32, 24]]


def test_images_with_times_fall_on_the_frame_of_that_time(tmp_path: Path) -> None:
    times = table("frames", t_ns=[0, 210_000_000, 499_000_000], frame=[0, 1, 2], stream=["depth"] * 3)
    images = [np.ones((4, 4), np.uint16)] * 3
    write_depth_file(tmp_path / "d.dep", enumerate(images))
    stream = Stream(name="depth", kind="depth", n_frames=3)
    session = with_stream(tmp_path, tmp_path / "d.dep", stream, frames=times)
    assert image_frames(session, stream, 3, scene(session)).tolist() == [0, 2, 4]


def test_the_camera_of_a_reduced_image_sees_the_same() -> None:
    camera = Camera(name="d", width_px=5, height_px=4, fx_px=10, fy_px=8, cx_px=2, cy_px=2)
    small = reduced(camera, 2)
    assert (small.width_px, small.height_px, small.fx_px, small.fy_px, small.cx_px, small.cy_px) == (
        3,
        2,
        5,
        4,
        1,
        1,
    )
