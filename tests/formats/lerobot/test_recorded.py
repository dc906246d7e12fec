"""Which recorded videos are copied, and what those that are not look like."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.formats.lerobot.options import LeRobotOptions
from ecat.formats.lerobot.recorded import Camera
from ecat.store import Session
from tests.formats.lerobot.recordings import Recording, grey, make

SHOWN = np.arange(15, 45)


def greys(shown: np.ndarray) -> list[int]:
    """How bright these images are."""
    return [grey(number) for number in shown.tolist()]


def film(path: Path, codec: str = "libx264", *, pix_fmt: str = "yuv420p", **options: str) -> None:
    """Sixty images as :mod:`recordings` has them, encoded as asked for."""
    import av

    with av.open(str(path), "w") as out:
        stream: Any = out.add_stream(codec, rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pix_fmt
        stream.codec_context.gop_size = 15
        for number in range(60):
            image = np.full((48, 64, 3), grey(number), np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        out.mux(stream.encode(None))


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """Sixty images at 30 a second."""
    return make(tmp_path, Recording())


def brightness(
    session: Session, tmp_path: Path, shown: np.ndarray, **options: object
) -> tuple[Camera, list[float]]:
    """How bright the images of an episode are, and the camera that they come from."""
    scratch = tmp_path / "scratch.mp4"
    with Camera(session, session.stream("color"), scratch, LeRobotOptions()) as camera:
        clip = camera.clip(shown, 30)
        context = clip.file.stream.codec_context
        packets = list(clip.file.packets(clip.first_pts, clip.count))
        frames = [frame for packet in [*packets, None] for frame in context.decode(packet)]
        found = [float(frame.to_ndarray(format="rgb24").mean()) for frame in frames]
    assert not scratch.exists()
    return camera, found


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        (".mp4", {"bf": "0"}),
        (".mkv", {"bf": "0"}),
        (".mp4", {"bf": "0", "pix_fmt": "yuvj420p"}),
    ],
)
def test_h264_without_detours_is_copied(
    session: Session, tmp_path: Path, suffix: str, options: dict[str, str]
) -> None:
    made = tmp_path / f"film{suffix}"
    film(made, **options)
    made.replace(session.stream_path("color"))
    camera, found = brightness(session, tmp_path, SHOWN)
    assert (camera.copied, camera.encoded) == (1, 0)
    assert found == pytest.approx(greys(SHOWN), abs=5)


@pytest.mark.parametrize(
    ("suffix", "codec", "options", "why"),
    [
        (".mp4", "libx264", {"bf": "2"}, "its images are not in the order in which they are shown"),
        (".avi", "mpeg4", {}, "mpeg4 yuv420p is no H.264 that every reader of MP4 knows"),
        (".avi", "libx264", {"bf": "0"}, "h264 yuv420p is no H.264 that every reader of MP4 knows"),
        (
            ".mp4",
            "libx264",
            {"pix_fmt": "yuv444p"},
            "h264 yuv444p is no H.264 that every reader of MP4 knows",
        ),
    ],
)
def test_everything_else_is_encoded_anew(
    session: Session, tmp_path: Path, suffix: str, codec: str, options: dict[str, str], why: str
) -> None:
    made = tmp_path / f"film{suffix}"
    film(made, codec, **options)
    made.replace(session.stream_path("color"))
    camera, found = brightness(session, tmp_path, SHOWN)
    assert camera.reasons == {why: 1}
    assert found == pytest.approx(greys(SHOWN), abs=5)


def test_an_episode_that_begins_between_key_frames_is_encoded_anew(session: Session, tmp_path: Path) -> None:
    camera, found = brightness(session, tmp_path, SHOWN + 1)
    assert camera.reasons == {"the episode does not begin with a key frame of the recording": 1}
    assert len(found) == 30


def test_an_image_that_is_shown_twice_is_there_twice(session: Session, tmp_path: Path) -> None:
    shown = np.array([3, 3, 3, 9, 9, 20])
    camera, found = brightness(session, tmp_path, shown)
    assert camera.encoded == 1
    assert found == pytest.approx(greys(shown), abs=16)  # a corner is blue
    assert found[0] == pytest.approx(found[2], abs=1)


def test_what_is_encoded_is_the_same_every_time(session: Session, tmp_path: Path) -> None:
    scratch = tmp_path / "scratch.mp4"
    with Camera(session, session.stream("color"), scratch, LeRobotOptions(encode="always")) as camera:
        made: list[bytes] = []
        for _ in range(2):
            camera.clip(SHOWN, 30)
            made.append(scratch.read_bytes())
    assert made[0] == made[1]
