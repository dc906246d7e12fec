"""Videos, images, distances and times."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tests.web.conftest import Browser

N, N_DEPTH = 180, 90


def proxy(browser: Browser, stream: str) -> dict[str, Any]:
    """What is said of a stream's proxy, once that is finished."""
    for _ in range(600):
        (found,) = (s["proxy"] for s in browser.json("")["streams"] if s["name"] == stream)
        if found["state"] != "making":
            return found
        time.sleep(0.05)
    raise AssertionError("the proxy was not made")


def images(data: bytes) -> list[NDArray[np.uint8]]:
    with av.open(io.BytesIO(data), "r") as container:
        return [frame.to_ndarray(format="bgr24").astype(np.uint8) for frame in container.decode(video=0)]


def test_image_k_of_the_proxy_is_image_k_of_the_stream(reader: Browser) -> None:
    from tests.web.conftest import read_number

    found = proxy(reader, "color")
    assert (found["state"], found["fps"]) == ("ready", 30)
    data = reader.get(found["url"]).content
    assert [read_number(image) for image in images(data)] == list(range(N))
    with av.open(io.BytesIO(data), "r") as container:
        video = container.streams.video[0]
        assert (video.codec_context.name, video.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert not video.codec_context.has_b_frames
        assert [
            round(float(p.pts * p.time_base) * 30) for p in container.demux(video) if p.pts is not None
        ] == [*range(N)]


def test_the_index_of_a_proxy_comes_first_so_that_seeking_needs_no_second_look(reader: Browser) -> None:
    data = reader.get(proxy(reader, "color")["url"]).content
    assert data.index(b"moov") < data.index(b"mdat")


def test_a_browser_gets_the_part_that_it_asks_for(reader: Browser) -> None:
    url = proxy(reader, "color")["url"]
    whole = reader.get(url)
    assert whole.headers["accept-ranges"] == "bytes"
    part = reader.get(url, headers={"range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, whole.content[10:20])
    assert part.headers["content-range"] == f"bytes 10-19/{len(whole.content)}"
    assert reader.get(url, headers={"range": "bytes=-5"}).content == whole.content[-5:]
    for beyond in ("bytes=999999999-", "bytes=-0"):
        assert reader.get(url, headers={"range": beyond}).status_code == 416
    for nonsense in (
        "",
        "bytes=",
        "bytes=-",
        "bytes=5-2",
        "lines=1-2",
        "bytes=0-1,4-5",
        "bytes=x-",
        f"bytes={'9' * 50}-",
    ):
        assert reader.get(url, headers={"range": nonsense}).content == whole.content
    assert reader.get(url, headers={"if-none-match": whole.headers["etag"]}).status_code == 304
    stale = reader.get(url, headers={"range": "bytes=0-9", "if-range": '"other"'})
    assert (stale.status_code, len(stale.content)) == (200, len(whole.content))


def test_depth_is_played_in_colours_and_black_where_nothing_was_measured(reader: Browser) -> None:
    shown = images(reader.get(proxy(reader, "depth")["url"]).content)
    assert len(shown) == N_DEPTH
    assert shown[0][:, :1].mean() < 40 < shown[0][:, 8:].mean()
    # nearer rows are darker, and none of the colours is a grey
    assert shown[0][4, 20].sum() < shown[0][-4, 20].sum()


def test_a_stream_without_a_file_or_images_has_no_video(reader: Browser) -> None:
    for stream in ("infrared", "skeleton", "nothing"):
        answer = reader.get(f"media/{stream}")
        assert answer.status_code == 404
        assert answer.json()["error"]["where"]


def test_a_frame_is_the_image_itself(reader: Browser) -> None:
    from tests.web.conftest import HEIGHT, WIDTH, read_number

    for k in (0, 1, 2, 90, 91, 30, 179, 178):
        answer = reader.get(f"frames/color/{k}.jpg")
        assert answer.headers["content-type"] == "image/jpeg"
        image = np.asarray(cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR), np.uint8)
        assert image.shape == (HEIGHT, WIDTH, 3)
        assert read_number(image) == k
    assert reader.get("frames/depth/89.jpg").status_code == 200
    for beyond in (
        "frames/color/180.jpg",
        "frames/color/-1.jpg",
        "frames/depth/90.jpg",
        "frames/nothing/0.jpg",
    ):
        assert reader.get(beyond).status_code == 404, beyond
    for wrong in ("frames/color/x.jpg", f"frames/color/{10**30}.jpg"):
        assert reader.get(wrong).status_code in {404, 422}, wrong


def test_the_distance_at_a_pixel_is_exact(reader: Browser) -> None:
    from tests.web.conftest import MM_PER_ROW

    at = reader.json("depth/depth/7?u=5&v=3")
    assert at["depth_m"] == pytest.approx((1000 + 3 * MM_PER_ROW + 7) / 1000)
    assert at["x"] is None  # nobody knows the camera
    assert reader.json("depth/depth/7?u=0&v=3") == {"depth_m": None, "x": None, "y": None, "z": None}
    assert reader.json("depth/depth/7?u=4.6&v=3.4")["depth_m"] == at["depth_m"]


@pytest.mark.parametrize(
    "query", ["u=48&v=3", "u=-1&v=3", "u=5&v=32", "u=nan&v=0", "u=inf&v=0", "u=1e300&v=1"]
)
def test_a_pixel_outside_of_the_image_is_refused(reader: Browser, query: str) -> None:
    assert reader.get(f"depth/depth/7?{query}").status_code == 400


def test_what_is_no_depth_is_not_measured(reader: Browser) -> None:
    assert reader.get("depth/color/0?u=1&v=1").status_code == 400
    assert reader.get("depth/depth/0").status_code == 422
    assert reader.get("depth/depth/90?u=1&v=1").status_code == 404


def test_a_point_is_told_where_the_camera_is_known(project: Path, browser: Browser) -> None:
    manifest = project / "slide" / "session.json"
    text = manifest.read_text()
    (before,) = (part for part in text.split('{\n      "name": "depth"') if '"kind": "depth"' in part[:80])
    manifest.write_text(text.replace(before, before.replace('"camera": ""', '"camera": "depth"', 1)))
    at = browser.json("depth/depth/0?u=5&v=3")
    camera = next(c for c in browser.json("")["cameras"] if c["name"] == "depth")
    u = camera["cx_px"] + (-1 if camera["mirrored"] else 1) * camera["fx_px"] * at["x"] / at["z"]
    v = camera["cy_px"] + camera["fy_px"] * at["y"] / at["z"]
    assert at["z"] == at["depth_m"]
    assert (u, v) == (pytest.approx(5, abs=30), pytest.approx(3, abs=30))  # but for the lens


def test_times_are_seconds_of_each_image(reader: Browser) -> None:
    times = np.frombuffer(reader.get("times/color").content, "<f8")
    assert len(times) == N
    assert (times[0], times[-1]) == (0, pytest.approx(5.969))
    # nobody knows when the depth images were taken
    assert reader.get("times/depth").status_code == 404
    assert reader.get("times/nothing").status_code == 404
