"""Images of a session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from rerun.chunk import Chunk

from ecat.formats.ecat2018.depth_file import write_depth_file
from ecat.model import Camera, Clock, Stream
from ecat.progress import silent
from ecat.store import Draft, Session, TableData, create_session
from ecat.store.media import DepthWriter
from ecat.view import media as view_media
from ecat.view.media import media
from ecat.view.scene import scene
from tests.view.chunks import at, table
from tests.view.conftest import draft

IMAGE, DEPTH = "/world/camera/color/image", "/world/camera/depth"


VIDEO = Stream(name="color", kind="color")
"""The annotated video, whose file is not there."""


def with_stream(
    tmp_path: Path,
    source: Path,
    stream: Stream,
    frames: pa.Table | None = None,
    *,
    cameras: Sequence[Camera] = (),
) -> Session:
    """A session with the ``source`` of one stream, and next to one of depth or infrared the name of its video."""
    small = draft()
    stream = replace(stream, file=f"media/{source.name}", present=True)
    streams = (stream,) if stream.kind == "color" else (VIDEO, stream)
    tables = dict(small.tables) | ({"frames": TableData(data=frames)} if frames is not None else {})
    clock = small.manifest.clock if frames is None else Clock(rule="recorded")
    manifest = replace(small.manifest, streams=streams, clock=clock, cameras=tuple(cameras))
    return create_session(
        tmp_path / "s",
        Draft(manifest=manifest, layers=small.layers, tables=tables, files={stream.name: source}),
    )


def depth_video(file: Path, images: Sequence[NDArray[np.uint16]]) -> Path:
    height, width = images[0].shape
    with DepthWriter(file, width, height) as writer:
        for i, image in enumerate(images):
            writer.write(image, i * 33_333_333)
    return file


def video(file: Path, images: list[NDArray[np.uint8]]) -> Path:
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 30, (width, height))
    for image in images:
        writer.write(image)
    writer.release()
    return file


def sent(session: Session, damage: list[str] | None = None) -> list[Chunk]:
    return list(media(session, scene(session), silent, [] if damage is None else damage))


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


@pytest.mark.parametrize("kind", ["color", "depth", "infrared"])
def test_what_cannot_be_decoded_is_said_in_the_log_and_to_who_asked(
    tmp_path: Path, kind: Literal["color", "depth", "infrared"]
) -> None:
    (tmp_path / "broken.mkv").write_bytes(b"no video at all")
    damage: list[str] = []
    chunks = sent(
        with_stream(tmp_path, tmp_path / "broken.mkv", Stream(name=kind, kind=kind, n_frames=3)), damage
    )
    (line,) = damage
    assert line.startswith(f"stream {kind}: could not be decoded: ")
    assert at(chunks, f"/log/media/{kind}", "text")[None] == [line]


def test_what_was_readable_before_a_fault_is_shown_and_the_rest_is_said_in_the_log(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(1, 5000, (6, 48, 64)).astype(np.uint16)
    whole = depth_video(tmp_path / "whole.mkv", list(noise)).read_bytes()
    (tmp_path / "d.mkv").write_bytes(whole[: len(whole) // 2])
    times = table("frames", t_ns=range(6), frame=range(6), stream=["depth"] * 6)
    damage: list[str] = []
    chunks = sent(
        with_stream(tmp_path, tmp_path / "d.mkv", Stream(name="depth", kind="depth"), times), damage
    )
    assert 0 < len(at(chunks, DEPTH, "blob")) < 6
    (line,) = damage
    assert "of 6 images" in line
    assert at(chunks, "/log/media/depth", "text")[None] == [line]


@pytest.mark.parametrize("name", ["d.mkv", "d.dep"])
@pytest.mark.parametrize(("width", "step"), [(96, 1), (322, 2)])
def test_depth_keeps_its_numbers_and_of_wide_images_every_second(
    tmp_path: Path, name: str, width: int, step: int
) -> None:
    images = [np.arange(96 * width, dtype=np.uint16).reshape(96, width) + 1000 * i for i in range(3)]
    file = tmp_path / name
    if name == "d.dep":
        write_depth_file(file, enumerate(images))
    else:
        depth_video(file, images)
    chunks = sent(with_stream(tmp_path, file, Stream(name="depth", kind="depth", n_frames=3)))
    shown = at(chunks, DEPTH, "blob")
    # three images over six frames
    assert list(shown) == [0, 2, 4]
    for blob, image in zip(shown.values(), images, strict=True):
        assert np.array_equal(decoded(blob), image[::step, ::step])


@pytest.mark.parametrize(("unit_m", "per_metre"), [(None, 1000), (0.0002, 5000)])
def test_the_viewer_is_told_the_unit_of_depth(tmp_path: Path, unit_m: float | None, per_metre: float) -> None:
    file = depth_video(tmp_path / "d.mkv", [np.full((8, 16), 900, np.uint16)])
    stream = Stream(name="depth", kind="depth", depth_unit_m=unit_m)
    chunks = sent(with_stream(tmp_path, file, stream))
    assert at(chunks, DEPTH, "meter")[None] == [pytest.approx(per_metre)]


def test_depth_seen_through_a_lens_is_shown_as_if_there_were_none(tmp_path: Path) -> None:
    bent = Camera(
        name="depth",
        width_px=65,
        height_px=49,
        fx_px=60,
        fy_px=60,
        cx_px=32,
        cy_px=24,
        distortion=(0.4, 0, 0, 0),
    )
    columns = np.tile(np.arange(1, 66, dtype=np.uint16), (49, 1))
    stream = Stream(name="depth", kind="depth", camera="depth")
    session = with_stream(tmp_path, depth_video(tmp_path / "d.mkv", [columns]), stream, cameras=[bent])
    (blob,) = at(sent(session), DEPTH, "blob").values()
    row = decoded(blob)[24].astype(int) - 1
    # k1 > 0 pushes outwards what is seen at x: it was recorded at x (1 + k1 x^2)
    x = (np.arange(65) - 32) / 60
    recorded = 32 + 60 * x * (1 + 0.4 * x**2)
    inside = recorded <= 64
    assert row[inside & (recorded >= 0)].tolist() == np.rint(recorded[inside & (recorded >= 0)]).tolist()
    assert (row[~inside] == -1).all()


def test_every_image_is_shown_at_its_own_time_and_at_the_nearest_frame(tmp_path: Path) -> None:
    times = table(
        "frames",
        t_ns=[0, 10, 100, 190, 200, 300],
        frame=[0, 0, 1, 1, 2, 3],
        stream=["color", "depth", "color", "depth", "color", "color"],
    )
    file = depth_video(tmp_path / "d.mkv", [np.ones((4, 4), np.uint16)] * 2)
    session = with_stream(tmp_path, file, Stream(name="depth", kind="depth"), times)
    batches = [c.to_record_batch() for c in sent(session) if c.entity_path == DEPTH and not c.is_static]
    assert [batch.column("frame").to_pylist() for batch in batches] == [[0, 2]]
    assert np.asarray(batches[0].column("session_time")).astype(np.int64).tolist() == [10, 190]


def test_infrared_images_become_grey_and_the_brightest_white(tmp_path: Path) -> None:
    image = np.zeros((8, 16), np.uint16)
    image[:, 8:] = 4000
    stream = Stream(name="infrared", kind="infrared")
    chunks = sent(with_stream(tmp_path, depth_video(tmp_path / "i.mkv", [image]), stream))
    (blob,) = at(chunks, "/world/camera/images/infrared/image", "blob").values()
    shown = decoded(blob)
    assert shown[4, 2] == pytest.approx(0, abs=3)
    assert shown[4, 13] == pytest.approx(255, abs=3)


def test_of_a_long_stream_every_second_image_is_shown_and_the_log_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(view_media, "MOST_IMAGES", 3)
    file = depth_video(tmp_path / "d.mkv", [np.full((4, 4), i, np.uint16) for i in range(1, 7)])
    damage: list[str] = []
    chunks = sent(with_stream(tmp_path, file, Stream(name="depth", kind="depth", n_frames=6)), damage)
    shown = at(chunks, DEPTH, "blob")
    assert {frame: int(decoded(blob)[0, 0]) for frame, blob in shown.items()} == {0: 1, 2: 3, 4: 5}
    assert "one image of every 2" in at(chunks, "/log/media/depth", "text")[None][0]
    assert damage == []


def test_images_are_sent_while_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view_media, "_BATCH", 2)
    file = depth_video(tmp_path / "d.mkv", [np.ones((4, 4), np.uint16)] * 5)
    chunks = sent(with_stream(tmp_path, file, Stream(name="depth", kind="depth", n_frames=5)))
    assert [c.num_rows for c in chunks if c.entity_path == DEPTH and not c.is_static] == [2, 2, 1]
