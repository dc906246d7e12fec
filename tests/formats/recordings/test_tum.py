"""TUM RGB-D folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.check import check
from ecat.errors import FormatError, LimitError
from ecat.formats import import_source, registry
from ecat.formats.recordings.timed_lists import parse_lines, parse_rows
from ecat.store import open_session
from ecat.store.media import open_images
from tests.store.media.clips import color_image, depth_image, number_of

START = 1305031102


def folder(path: Path, color: Sequence[str], depth: Sequence[str]) -> Path:
    """A recording whose images have these times."""
    for kind, times in (("rgb", color), ("depth", depth)):
        (path / kind).mkdir(parents=True)
        lines = ["# made for a test"]
        for i, time in enumerate(times):
            image = color_image(i) if kind == "rgb" else depth_image(i)
            assert cv2.imwrite(str(path / kind / f"{time}.png"), image)
            lines.append(f"{time} {kind}/{time}.png")
        (path / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    return path


def times(n: int, offset_us: int = 0) -> list[str]:
    return [f"{START}.{100_000 + 33_000 * i + offset_us:06}" for i in range(n)]


def test_every_stream_keeps_its_own_times(tmp_path: Path) -> None:
    source = folder(tmp_path / "desk", times(4), times(3, 11_000))
    report = import_source(source, tmp_path / "s")
    session = open_session(report.path)
    assert report.format == "tum-rgbd"
    color, depth = open_images(session, "color"), open_images(session, "depth")
    np.testing.assert_array_equal(color.t_ns, np.arange(4) * 33_000_000)
    np.testing.assert_array_equal(depth.t_ns, np.arange(3) * 33_000_000 + 11_000_000)
    assert [number_of(image) for image in color] == [0, 1, 2, 3]
    for i, image in enumerate(depth):
        np.testing.assert_array_equal(image, depth_image(i))
    assert session.stream("depth").depth_unit_m == 1 / 5000
    assert session.manifest.clock.start == "2011-05-10T12:38:22.100000+00:00"
    assert [f for f in check(report.path) if f.severity == "error"] == []


def test_ground_truth_and_accelerometer_become_tables(tmp_path: Path) -> None:
    source = folder(tmp_path / "in", times(2), times(2))
    (source / "groundtruth.txt").write_text(
        f"# path\n{START}.0 1 2 3 0 0 0 1\n{START}.2 1 2 3 0 0 0 9\n{START}.3 1 2\n"
    )
    (source / "accelerometer.txt").write_text(f"{START}.15 0.5 -9.8 0.1\n{START}.14 0 0 0\n")
    report = import_source(source, tmp_path / "s")
    session = open_session(report.path)
    (pose,) = session.table("camera_poses").to_arrow().to_pylist()
    assert (pose["t_ns"], pose["frame"], pose["x"], pose["qw"]) == (-100_000_000, None, 1, 1)
    imu = session.table("imu").to_arrow().to_pylist()
    assert [row["t_ns"] for row in imu] == [40_000_000, 50_000_000]
    assert {row["sensor"] for row in imu} == {"accelerometer"}
    told = " ".join(report.findings)
    assert "1 lines do not have 7 numbers" in told
    assert "1 rotations are no unit quaternions" in told
    assert "accelerometer.txt: time runs backwards" in told
    assert [f for f in check(report.path) if f.severity == "error"] == []


def test_a_clock_that_jumps_back_is_sorted_and_told(tmp_path: Path) -> None:
    stamps = times(4)
    source = folder(tmp_path / "in", [stamps[0], stamps[2], stamps[1], stamps[3]], stamps)
    report = import_source(source, tmp_path / "s")
    images = open_images(open_session(report.path), "color")
    np.testing.assert_array_equal(images.t_ns, np.arange(4) * 33_000_000)
    assert [number_of(image) for image in images] == [0, 2, 1, 3]
    assert any("runs backwards 1 times" in finding for finding in report.findings)


def test_paths_that_lead_out_are_not_followed(tmp_path: Path) -> None:
    source = folder(tmp_path / "in", times(2), times(2))
    secret = tmp_path / "secret.png"
    assert cv2.imwrite(str(secret), color_image(9))
    (source / "rgb" / "link.png").symlink_to(secret)
    with (source / "rgb.txt").open("a") as file:
        for i, name in enumerate(
            ("../secret.png", str(secret), "rgb/link.png", "rgb/none.png", "rgb/\0.png")
        ):
            file.write(f"{START + 1 + i}.0 {name}\n")
    report = import_source(source, tmp_path / "s")
    assert [number_of(image) for image in open_images(open_session(report.path), "color")] == [0, 1]
    assert any("4 paths lead out of the folder" in finding for finding in report.findings)
    assert any("1 of 7 images are not there" in finding for finding in report.findings)


def test_colour_without_depth_is_imported_and_told(tmp_path: Path) -> None:
    source = folder(tmp_path / "in", times(2), [])
    (source / "depth.txt").unlink()
    report = import_source(source, tmp_path / "s")
    assert [stream.name for stream in open_session(report.path).manifest.streams] == ["color"]
    assert "there is no depth.txt" in report.findings


def test_nothing_readable_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "rgb.txt").write_bytes(b"\xff\xfe what is this\n" * 3)
    assert registry.sniff(tmp_path / "in").name == "tum-rgbd"
    with pytest.raises(FormatError, match="cannot import") as caught:
        import_source(tmp_path / "in", tmp_path / "s")
    assert "3 lines" in caught.value.where
    assert not (tmp_path / "s").exists()


def test_too_many_pixels_are_refused(tmp_path: Path) -> None:
    source = folder(tmp_path / "in", times(2), times(2))
    path = source / "rgb" / f"{times(2)[1]}.png"
    data = bytearray(path.read_bytes())
    data[16:24] = (12_000).to_bytes(4, "big") + (9_000).to_bytes(4, "big")
    path.write_bytes(data)
    with pytest.raises(LimitError, match="cannot"):
        import_source(source, tmp_path / "s")
    assert not (tmp_path / "s").exists()


@given(st.lists(st.integers(0, (1 << 62) - 1), max_size=20))
def test_times_are_exact_to_the_nanosecond(t_ns: list[int]) -> None:
    text = "".join(f"{t // 10**9}.{t % 10**9:09} a {t}\n" for t in t_ns)
    found = parse_lines(text.encode(), "rgb.txt")
    assert found.t_ns == sorted(t_ns)
    assert found.rest == [f"a {t}" for t in sorted(t_ns)]


@given(st.binary(max_size=200))
def test_any_bytes_are_lines_or_counted(data: bytes) -> None:
    found = parse_lines(data, "rgb.txt")
    assert len(found.t_ns) == len(found.rest)
    assert found.t_ns == sorted(found.t_ns)
    t_ns, values, _ = parse_rows(data, "groundtruth.txt", 7)
    assert values.shape == (len(t_ns), 7)
    assert np.isfinite(values).all()
