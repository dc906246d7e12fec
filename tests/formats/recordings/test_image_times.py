"""A video beside a folder of images: both are imported, and what is known of their times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.check import check
from ecat.formats import import_source, registry
from ecat.formats.recordings.image_times import times_of
from ecat.formats.recordings.rows import wall_clock
from ecat.store import Session, open_session, validate
from ecat.store.media import open_images
from tests.formats.recordings.test_rgbd_video import N, encoded, folder, imported
from tests.store.media.clips import PERIOD_NS, color_clip, color_image, depth_image, number_of


def images(path: Path, names: Sequence[str], *, deep: bool) -> None:
    """A folder of images, one by one those of the clips."""
    path.mkdir(parents=True)
    for i, name in enumerate(names):
        image = depth_image(i) if deep else color_image(i)
        assert cv2.imwrite(str(path / name), image)


def times(session: Session, name: str) -> list[int] | None:
    t_ns = open_images(session, name).t_ns
    return None if t_ns is None else t_ns.tolist()


NUMBERED = [f"{i:05}.png" for i in range(N)]
WALL_NS = [1_305_031_102_160_407_000 + i * 33_400_000 for i in range(N)]
BY_WALL = [f"{t_ns // 10**9}.{t_ns % 10**9 // 1000:06}" for t_ns in WALL_NS]


@pytest.mark.parametrize("video", ["color.mp4", "rgb.mp4", "IMG_0042.mp4"])
def test_a_video_and_a_folder_of_depth_are_both_imported(tmp_path: Path, video: str) -> None:
    source = folder(tmp_path / "r", color=False, depth=False)
    color_clip(source / video, N)
    images(source / "depth", NUMBERED, deep=True)
    assert registry.sniff(source).name == "rgbd-video"
    session = imported(source)
    assert [number_of(image) for image in open_images(session, "color")] == list(range(N))
    for i, image in enumerate(open_images(session, "depth")):
        np.testing.assert_array_equal(image, depth_image(i))
    assert session.stream("depth").depth_unit_m == 0.0005
    assert [session.stream(name).camera for name in ("color", "depth")] == ["color", "depth"]
    assert validate(session, deep=True) == []


def test_what_nothing_tells_of_the_times_is_unknown_and_said_so(tmp_path: Path) -> None:
    source = folder(tmp_path / "r", depth=False)
    images(source / "depth", NUMBERED[::2], deep=True)
    session = imported(source)
    color = times(session, "color")
    assert color is not None
    assert np.abs(np.array(color) - np.arange(N) * PERIOD_NS).max() <= 1000
    assert times(session, "depth") is None
    assert open_images(session, "depth").frame.tolist() == [0, 2, 4, 6]
    said = [(finding.code, finding.place) for finding in check(session.path) if finding.severity != "note"]
    assert said == []
    told = [finding for finding in check(session.path) if finding.code == "clock-unknown"]
    assert [finding.place for finding in told] == ["stream depth"]
    notes = session.manifest.provenance.notes
    assert any("not known when its images were taken" in note for note in notes)
    assert any("8 colour images and 4 depth images" in note for note in notes)


def test_a_list_tells_the_times_by_the_video_s_own_zero(tmp_path: Path) -> None:
    source = folder(tmp_path / "r", depth=False)
    images(source / "depth", NUMBERED, deep=True)
    late_ns = [250_000_000 + i * PERIOD_NS for i in range(N)]
    lines = [f"{t_ns / 1e9:.7f} depth/{name}" for t_ns, name in zip(late_ns, NUMBERED, strict=True)]
    (source / "depth.txt").write_text("# time image\n" + "\n".join(reversed(lines)))
    session = imported(source)
    assert times(session, "depth") == late_ns
    color = times(session, "color")
    assert color is not None
    assert abs(color[0]) <= 1000


@pytest.mark.parametrize("unit_ns", [1, 1000, 1_000_000])
def test_names_are_times_if_they_count_from_1970_but_then_the_video_s_are_wanted_too(
    tmp_path: Path, unit_ns: int
) -> None:
    source = folder(tmp_path / "r", depth=False)
    images(source / "depth", [f"depth_{t_ns // unit_ns}.png" for t_ns in WALL_NS], deep=True)
    untied = imported(source)
    assert times(untied, "depth") is None
    assert any("count from 1970" in note for note in untied.manifest.provenance.notes)
    # a time for every image of the video, seconds since 1970, ties both
    (source / "color_timestamps.txt").write_text("\n".join(BY_WALL))
    session = open_session(import_source(source, tmp_path / "tied").path)
    start_ns = WALL_NS[0] // unit_ns * unit_ns
    assert times(session, "color") == [t // 1000 * 1000 - start_ns for t in WALL_NS]
    assert times(session, "depth") == [t // unit_ns * unit_ns - start_ns for t in WALL_NS]
    assert session.manifest.clock.start == wall_clock(start_ns)


def test_a_list_of_a_video_that_is_encoded_anew_counts_as_well(tmp_path: Path) -> None:
    source = folder(tmp_path / "r", color=False)
    encoded(source / "color.avi", [color_image(i) for i in range(N)], "mjpeg", "yuvj420p", source_fmt="bgr24")
    told = [i * 50_000_000 for i in range(N)]
    (source / "color_times.txt").write_text("".join(f"{t / 1e9:.3f}\n" for t in told))
    session = imported(source)
    assert times(session, "color") == told
    assert session.stream("color").codec == "h264"


@pytest.mark.parametrize("listed", [False, True])
def test_a_folder_of_colour_and_a_video_of_depth_are_both_imported(tmp_path: Path, listed: bool) -> None:
    source = folder(tmp_path / "r", color=False)
    images(source / "rgb", [f"{i}.png" for i in range(N)], deep=False)
    if listed:
        (source / "rgb" / "timestamps.txt").write_text("".join(f"{i / 30:.6f}\n" for i in range(N)))
    session = imported(source)
    assert [number_of(image) for image in open_images(session, "color")] == list(range(N))
    depth = times(session, "depth")
    assert depth is not None
    assert np.abs(np.array(depth) - np.arange(N) * PERIOD_NS).max() <= 1000
    assert (times(session, "color") is not None) == listed
    assert session.manifest.n_frames == N
    unknown = [finding.place for finding in check(session.path) if finding.code == "clock-unknown"]
    assert unknown == ([] if listed else ["stream color"])
    assert validate(session, deep=True) == []


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("0.1\n0.2\n", "it has times for 2 images, and there are 8"),
        ("".join(f"{i}\n" for i in range(N)), "8 lines have no time whose unit is known"),
        ("".join(f"{i % 2}.5\n" for i in range(N)), "images of the same time"),
        ("".join(f"{9 - i}.5\n" for i in range(N)), "its times run backwards"),
        ("".join(f"{i}.5 {name}\n" for i, name in enumerate(NUMBERED[1:])), "1 of 8 images are not in it"),
    ],
)
def test_a_list_that_cannot_be_used_is_told_about(tmp_path: Path, content: str, told: str) -> None:
    source = folder(tmp_path / "r", depth=False)
    images(source / "depth", NUMBERED, deep=True)
    (source / "depth.txt").write_text(content)
    session = imported(source)
    assert any(told in note for note in session.manifest.provenance.notes)
    assert validate(session) == []


def test_numbers_and_dates_are_no_times(tmp_path: Path) -> None:
    for names in (["00001", "00002"], ["20240305100000", "20240305100001"], ["v1.2", "v1.3"], ["a", "b"]):
        paths = [tmp_path / f"{name}.png" for name in names]
        assert times_of(tmp_path, "depth", paths, "cannot import it", []) is None


@given(st.binary(max_size=300), st.integers(0, 5))
def test_any_list_gives_ascending_times_or_none(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, n: int
) -> None:
    source = tmp_path_factory.mktemp("list")
    (source / "depth.txt").write_bytes(data)
    found = times_of(source, "depth", [source / f"{i}.png" for i in range(n)], "cannot import it", [])
    if found is not None:
        assert len(found.t_ns) == len(found.paths) > 0
        assert found.t_ns == sorted(set(found.t_ns))


def test_both_as_video_leave_images_of_one_kind_alone(tmp_path: Path) -> None:
    source = folder(tmp_path / "r")
    images(source / "depth", ["00000.png"], deep=True)
    assert imported(source).manifest.provenance.notes == ("depth was not imported",)


def test_depth_images_of_raw_disparities_become_depth_beside_a_video_too(tmp_path: Path) -> None:
    source = folder(tmp_path / "r", depth=False, camera=None)
    (source / "depth").mkdir()
    raw = np.full((24, 34), 900, ">u2")
    raw[0, 0] = 2047
    (source / "depth" / "d-0.pgm").write_bytes(b"P5 34 24 65535\n" + raw.tobytes())
    (image,) = open_images(imported(source), "depth")
    assert image[0, 0] == 0
    assert image[1, 1] * 0.0002 == pytest.approx(351.3 / (1092.5 - 900), abs=0.0002)
