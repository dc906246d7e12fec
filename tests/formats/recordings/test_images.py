"""Images in files: sequences, pairs, single ones."""

from __future__ import annotations

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ecat.check import check
from ecat.errors import EcatError, FormatError, LimitError
from ecat.formats import import_source, registry
from ecat.formats.recordings.image_files import decode, parse_header
from ecat.formats.recordings.image_tracks import disparity_to_depth
from ecat.formats.recordings.known_cameras import parse_calibration
from ecat.store import Session, find_sessions, open_session
from ecat.store.media import open_images

SIZE = (48, 64)


def color(i: int = 0, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    return np.full((*size, 3), (20 * i % 256, 100, 200), np.uint8)


def depth(i: int = 0, size: tuple[int, int] = SIZE) -> NDArray[np.uint16]:
    rows, columns = np.indices(size)
    return (500 + 100 * i + 7 * rows + columns).astype(np.uint16)


def write(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def sequence(folder: Path, n: int = 3) -> Path:
    for i in range(n):
        write(folder / "color" / f"{i:05}.jpg", color(i))
        write(folder / "depth" / f"{i:05}.png", depth(i))
    return folder


def depths(session: Session) -> list[NDArray[np.uint16]]:
    return list(open_images(session, "depth"))


def errors_of(path: Path) -> list[str]:
    return [finding.code for finding in check(path) if finding.severity == "error"]


def test_a_sequence_becomes_a_session_with_depth_to_the_last_bit(tmp_path: Path) -> None:
    report = import_source(sequence(tmp_path / "desk"), tmp_path / "s")
    session = open_session(report.path)
    assert report.format == "images"
    assert session.manifest.n_frames == 3
    assert session.manifest.clock.rule == "unknown"
    for i, image in enumerate(depths(session)):
        np.testing.assert_array_equal(image, depth(i))
    for i, image in enumerate(open_images(session, "color")):
        assert np.abs(image.astype(int) - color(i)).max() <= 8
    assert session.stream("depth").depth_unit_m == 0.001
    assert any("taken for millimetres" in finding for finding in report.findings)
    assert sum("its camera is unknown" in finding for finding in report.findings) == 2
    assert errors_of(report.path) == []


def test_numbers_count_not_their_digits(tmp_path: Path) -> None:
    for i in (2, 10, 1):
        write(tmp_path / "in" / f"depth{i}.png", depth(i))
        write(tmp_path / "in" / f"color{i}.png", color(i))
    session = open_session(import_source(tmp_path / "in", tmp_path / "s").path)
    assert [int(image[0, 0]) for image in depths(session)] == [600, 700, 1500]


def test_images_without_a_partner_are_left_out_and_told(tmp_path: Path) -> None:
    sequence(tmp_path / "in", 4)
    (tmp_path / "in" / "depth" / "00001.png").unlink()
    report = import_source(tmp_path / "in", tmp_path / "s")
    session = open_session(report.path)
    assert [int(image[0, 0]) for image in depths(session)] == [500, 700, 800]
    assert len(open_images(session, "color")) == 3
    assert any("1 colour images have no depth image" in finding for finding in report.findings)


def test_the_match_file_says_what_belongs_together(tmp_path: Path) -> None:
    sequence(tmp_path / "in", 3)
    (tmp_path / "in" / "rgbd.match").write_text("depth/00002.png color/00000.jpg\n../x color/00001.jpg\n")
    report = import_source(tmp_path / "in", tmp_path / "s")
    assert [int(image[0, 0]) for image in depths(open_session(report.path))] == [700]
    assert any("4 images are not in rgbd.match" in finding for finding in report.findings)


def test_pairs_of_different_kinds_become_a_project(tmp_path: Path) -> None:
    for name, size in (("desk", SIZE), ("floor", (60, 80))):
        write(tmp_path / "in" / f"{name}_color.png", color(0, size))
        write(tmp_path / "in" / f"{name}_depth.png", depth(0, size))
    report = import_source(tmp_path / "in", tmp_path / "p")
    assert report.sessions == 2
    sessions = [open_session(path) for path in find_sessions(report.path)]
    assert [session.name for session in sessions] == ["desk", "floor"]
    assert [session.stream("depth").width_px for session in sessions] == [64, 80]
    assert errors_of(report.path) == []


def test_a_calibration_beside_the_images_gives_cameras_and_unit(tmp_path: Path) -> None:
    sequence(tmp_path / "in", 2)
    # written for twice the size: the lens is the same
    document = {"fx": 100, "fy": 101, "cx": 63.5, "cy": 47.5, "width": 128, "height": 96, "depth_scale": 5000}
    (tmp_path / "in" / "intrinsics.json").write_text(json.dumps(document))
    session = open_session(import_source(tmp_path / "in", tmp_path / "s").path)
    camera = session.manifest.camera("depth")
    assert camera is not None
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (50, 50.5, 31.5, 23.5)
    assert session.stream("depth").depth_unit_m == pytest.approx(1 / 5000)
    assert session.stream("color").camera == "color"


@pytest.mark.parametrize(
    "document",
    [
        [],
        {},
        {"fx": 1, "fy": 1, "cx": "x", "cy": 1},
        {"fx": -1, "fy": 1, "cx": 1, "cy": 1},
        {"fx": 1, "fy": 1, "cx": float("nan"), "cy": 1},
        {"K": [1]},
        {"intrinsic_matrix": {}},
        {"color": 3, "depth": None},
        {"fx": 1, "fy": 1, "cx": 1, "cy": 1, "width": 0},
        {"fx": 1, "fy": 1, "cx": 1, "cy": 1, "rotation": [1]},
    ],
)
def test_a_calibration_that_is_none_is_told_and_gives_no_camera(document: object) -> None:
    found = parse_calibration(document, "intrinsics.json", (64, 48), (64, 48))
    assert found.cameras == ()
    assert found.notes


_PINHOLE: dict[str, object] = {"fx": 50, "fy": 51, "cx": 30, "cy": 20}


@pytest.mark.parametrize("mirrored", ["false", "no", 0, 1, None, []])
def test_what_only_looks_like_true_or_false_does_not_mirror_a_camera(mirrored: object) -> None:
    found = parse_calibration(_PINHOLE | {"mirrored": mirrored}, "camera.json", (64, 48), None)
    assert found.cameras == ()
    assert "mirrored: expected true or false" in found.notes[0]


@pytest.mark.parametrize("width", [0, -64, 1e308, 70_000])
def test_a_calibration_for_images_that_no_camera_has_is_not_scaled(width: float) -> None:
    found = parse_calibration(_PINHOLE | {"width": width, "height": 48}, "camera.json", (64, 48), None)
    assert found.cameras == ()
    assert "expected 1 to 65536 pixels" in found.notes[0]


def test_a_calibration_for_images_of_another_shape_is_told() -> None:
    scaled = parse_calibration(_PINHOLE | {"width": 128, "height": 96}, "camera.json", (64, 48), None)
    assert scaled.notes == ()
    (note,) = parse_calibration(_PINHOLE | {"width": 128, "height": 72}, "camera.json", (64, 48), None).notes
    assert "calibrated for images of 128 x 72, and these are 64 x 48" in note


@pytest.mark.parametrize("unit", [{"depth_unit_m": 1000}, {"depth_unit_m": float("nan")}, {"depth_scale": 0}])
def test_a_unit_that_no_depth_has_is_told(unit: dict[str, object]) -> None:
    found = parse_calibration(_PINHOLE | unit, "camera.json", (64, 48), (64, 48))
    assert found.depth_unit_m is None
    assert found.notes == (
        f"camera.json: {next(iter(unit))} is not used, as it says nothing between 1e-6 and 1 m per unit",
    )


def test_open3ds_matrix_is_read_column_by_column() -> None:
    document = {"width": 64, "height": 48, "intrinsic_matrix": [50, 0, 0, 0, 51, 0, 30, 20, 1]}
    (camera,) = parse_calibration(document, "camera.json", (64, 48), None).cameras
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (50, 51, 30, 20)
    assert camera.reference == ""


def test_a_single_image_and_plain_numbered_images_are_colour(tmp_path: Path) -> None:
    one = write(tmp_path / "photo.png", color())
    session = open_session(import_source(one, tmp_path / "one").path)
    assert [stream.name for stream in session.manifest.streams] == ["color"]
    for i in range(3):
        write(tmp_path / "many" / f"IMG_{i}.bmp", color(i))
    report = import_source(tmp_path / "many", tmp_path / "s")
    assert open_session(report.path).manifest.n_frames == 3
    assert any("no depth images" in finding for finding in report.findings)


def test_sixteen_bits_of_grey_are_depth_whatever_their_name(tmp_path: Path) -> None:
    for i in range(2):
        write(tmp_path / "in" / f"{i}.tif", depth(i))
    report = import_source(tmp_path / "in", tmp_path / "s")
    np.testing.assert_array_equal(depths(open_session(report.path))[1], depth(1))
    assert any("no colour images" in finding for finding in report.findings)


def test_a_trajectory_becomes_camera_poses(tmp_path: Path) -> None:
    sequence(tmp_path / "in", 2)
    turned = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    poses = [np.eye(4), turned, 2 * np.eye(4)]
    text = "".join(
        f"{i} {i} {i + 1}\n" + "\n".join(" ".join(map(str, r)) for r in p) + "\n" for i, p in enumerate(poses)
    )
    (tmp_path / "in" / "trajectory.log").write_text(text)
    report = import_source(tmp_path / "in", tmp_path / "s")
    rows = open_session(report.path).table("camera_poses").to_arrow().to_pylist()
    assert [row["frame"] for row in rows] == [0, 1]
    assert [rows[1][name] for name in ("x", "y", "z")] == [1, 2, 3]
    half = np.sqrt(0.5)
    np.testing.assert_allclose([rows[1][n] for n in ("qx", "qy", "qz", "qw")], [0, 0, half, half], atol=1e-12)
    assert any("1 poses are not rigid" in finding for finding in report.findings)
    assert errors_of(report.path) == []


# --- Kinect v1


@given(st.integers(320, 1055))
def test_disparities_become_depth_without_merging_any(value: int) -> None:
    two = disparity_to_depth(np.array([[value, value + 1, 2047]], np.uint16))[0]
    assert two[0] * 0.0002 == pytest.approx(351.3 / (1092.5 - value), abs=0.0001) or two[0] == 0
    assert two[2] == 0
    assert two[1] > two[0] or two[1] == 0


@pytest.mark.parametrize("order", ["<", ">"])
def test_disparities_are_known_in_either_order_of_bytes(tmp_path: Path, order: str) -> None:
    values = np.full((480, 640), 2047, np.uint16)
    values[100:300, 100:300] = 800
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "room_depth.pgm").write_bytes(
        b"P5 640 480 65535\n" + values.astype(f"{order}u2").tobytes()
    )
    write(tmp_path / "in" / "room_color.ppm", color(0, (480, 640)))
    report = import_source(tmp_path / "in", tmp_path / "s")
    session = open_session(report.path)
    (image,) = depths(session)
    assert image[200, 200] * session.stream("depth").depth_unit_m == pytest.approx(351.3 / 292.5, abs=1e-4)
    assert image[0, 0] == 0
    camera = session.manifest.camera("color")
    assert camera is not None
    assert camera.reference == "depth"
    assert any("NYU Depth V2" in finding for finding in report.findings)


# --- damage


@pytest.mark.parametrize("name", ["color/00001.jpg", "depth/00001.png"])
@pytest.mark.parametrize("keep", [0, 20, 0.6])
def test_a_damaged_image_is_told_and_the_others_stay_with_their_partners(
    tmp_path: Path, name: str, keep: float
) -> None:
    sequence(tmp_path / "in", 3)
    path = tmp_path / "in" / name
    data = path.read_bytes()
    path.write_bytes(data[: int(keep if keep > 1 else keep * len(data))])
    report = import_source(tmp_path / "in", tmp_path / "s")
    assert any("could not be read" in finding or "cannot be used" in finding for finding in report.findings)
    session = open_session(report.path)
    blue = [round(int(image[5, 5, 0]) / 20) for image in open_images(session, "color")]
    pairs = list(zip(blue, depths(session), strict=True))
    assert [i for i, _ in pairs] in ([0, 2], [0, 1, 2])
    for i, image in pairs:
        # a depth image that broke in its data, not in its head, counts as not measured
        np.testing.assert_array_equal(image, depth(i) if image.any() or i != 1 else 0)
    assert errors_of(report.path) == []


def test_depth_that_is_none_is_left_out_and_colour_kept(tmp_path: Path) -> None:
    sequence(tmp_path / "in", 2)
    for path in (tmp_path / "in" / "depth").iterdir():
        write(path, color()[..., 0])
    report = import_source(tmp_path / "in", tmp_path / "s")
    assert [stream.name for stream in open_session(report.path).manifest.streams] == ["color"]
    assert any("16-bit PNG" in finding for finding in report.findings)


def test_eight_bit_depth_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "in" / "depth" / "1.png", color()[..., 0])
    with pytest.raises(FormatError, match="cannot import"):
        import_source(tmp_path / "in", tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_a_hundred_megapixels_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    path = write(tmp_path / "in" / "1.png", color())
    data = bytearray(path.read_bytes())
    data[16:24] = (12_000).to_bytes(4, "big") + (9_000).to_bytes(4, "big")
    path.write_bytes(data)
    for source in (path, tmp_path / "in"):
        with pytest.raises(LimitError, match="cannot import") as caught:
            import_source(source, tmp_path / "s")
        assert "12000 x 9000" in caught.value.where


def test_other_sizes_and_pipes_do_no_harm(tmp_path: Path) -> None:
    sequence(tmp_path / "in", 2)
    write(tmp_path / "in" / "color" / "00002.jpg", color(2, (30, 40)))
    write(tmp_path / "in" / "depth" / "00002.png", depth(2))
    os.mkfifo(tmp_path / "in" / "color" / "00003.jpg")
    report = import_source(tmp_path / "in", tmp_path / "p")
    assert sorted(open_session(path).manifest.n_frames for path in find_sessions(report.path)) == [1, 2]


def test_a_video_beside_the_images_is_told_about(tmp_path: Path) -> None:
    sequence(tmp_path / "in", 2)
    (tmp_path / "in" / "color.mp4").write_bytes(b"")
    report = import_source(tmp_path / "in", tmp_path / "s")
    assert any("color.mp4" in finding for finding in report.findings)


def test_an_empty_folder_is_none_of_the_formats(tmp_path: Path) -> None:
    (tmp_path / "color").mkdir()
    with pytest.raises(FormatError, match="cannot import"):
        registry.sniff(tmp_path)
    with pytest.raises(FormatError, match="cannot import"):
        import_source(tmp_path, tmp_path / "s", format="images")


_SEEDS = [
    cv2.imencode(suffix, image)[1].tobytes()
    for suffix, image in (
        (".png", color()),
        (".png", depth()),
        (".jpg", color()),
        (".ppm", color()),
        (".pgm", depth()),
        (".bmp", color()),
        (".tiff", depth()),
    )
]


@pytest.mark.parametrize("data", _SEEDS)
def test_the_header_tells_size_and_depth_before_anything_is_decoded(data: bytes) -> None:
    header = parse_header(data)
    assert header is not None
    assert (header.height_px, header.width_px) == SIZE
    image = decode(data, "cannot read it", "it", deep=header.is_deep)
    np.testing.assert_array_equal(image.shape[:2], SIZE)
    if header.is_deep:
        np.testing.assert_array_equal(image, depth())


@given(
    st.sampled_from(_SEEDS),
    st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=8),
    st.booleans(),
)
def test_any_bytes_give_an_image_or_one_typed_error(
    data: bytes, changes: list[tuple[int, int]], deep: bool
) -> None:
    damaged = bytearray(data)
    for at, value in changes:
        damaged[at % len(damaged)] = value
    try:
        image = decode(bytes(damaged), "cannot read it", "it", deep=deep)
    except EcatError:
        return
    assert image.dtype == (np.uint16 if deep else np.uint8)


# --- real data


def test_real_pairs(shared: Path, tmp_path: Path) -> None:
    report = import_source(shared / "rgbd_images" / "pairs", tmp_path / "p")
    nyu, tum = (open_session(path) for path in find_sessions(report.path))
    assert (nyu.name, tum.name) == ("NYU", "TUM")
    for session, nearest, farthest in ((nyu, 1.2, 8.0), (tum, 0.5, 10.0)):
        (image,) = depths(session)
        unit = session.stream("depth").depth_unit_m
        assert unit is not None
        metres = image[image > 0] * unit
        assert nearest < np.percentile(metres, 1) < np.percentile(metres, 99) < farthest
        assert {camera.name for camera in session.manifest.cameras} == {"color", "depth"}
    raw = cv2.imread(str(shared / "rgbd_images" / "pairs" / "TUM_depth.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(depths(tum)[0], raw)
    assert errors_of(report.path) == []


def test_real_sequence(shared: Path, tmp_path: Path) -> None:
    source = shared / "rgbd_images" / "sequence"
    session = open_session(import_source(source, tmp_path / "s").path)
    assert session.manifest.n_frames == 5
    for path, image in zip(sorted((source / "depth").iterdir()), depths(session), strict=True):
        np.testing.assert_array_equal(image, cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    assert session.table("camera_poses").to_arrow().num_rows == 5
