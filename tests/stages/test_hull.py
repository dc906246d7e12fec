"""Shapes drawn in a few images, in all the others; and the hulls of what is inside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats
from ecat.stages.hull import HULL, HullParameters, follow_objects
from ecat.stages.shapes import drawn_shapes, partners
from ecat.tables import HULLS, KEYFRAMES, TABLE_PLANE, TRACKS_2D
from tests.stages.stills import Stills

COLOR = Camera("color", 320, 240, fx=300.0, fy=300.0, cx=159.5, cy=119.5, reference="camera/depth")
DEPTH = Camera("depth", 160, 120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)
BOX = np.array([[100.0, 80.0], [160.0, 80.0], [160.0, 130.0], [100.0, 130.0]])
N = 30
NEAR_M, FAR_M = 1.0, 2.0


def texture(seed: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    sheets = [
        np.asarray(cv2.resize(rng.normal(0, 1, (n * 3, n * 4)), (320, 240), interpolation=cv2.INTER_CUBIC))
        for n in (5, 10, 20, 40)
    ]
    return np.clip(128 + 25 * sum(sheets), 0, 255).astype(np.uint8)


FRONT, BEHIND = texture(2), texture(7)


def shift(k: int) -> int:
    """Pixels to the right by which the thing has moved."""
    return 3 * int(np.clip(k - 5, 0, 15))


def moved(k: int) -> Floats:
    """The thing's outline."""
    return BOX + np.array([shift(k), 0])


def color_image(k: int) -> NDArray[np.uint8]:
    image = BEHIND.copy()
    image[80:131, 100 + shift(k) : 161 + shift(k)] = FRONT[80:131, 100:161]
    return np.repeat(image[..., None], 3, 2)


def depth_image(k: int) -> NDArray[np.uint16]:
    """The thing is a roof, its ridge 45 mm nearer than its eaves."""
    image = np.full((120, 160), 1000 * FAR_M, np.uint16)
    left = round((100 + shift(k)) / 2)
    image[40:66, left : left + 31] = 1000 * NEAR_M - 3 * np.minimum(np.arange(31), np.arange(31)[::-1])
    return image


def film(make: Callable[[int], NDArray[np.uint8]] = color_image, n: int = N) -> Stills:
    return Stills(make, n, COLOR, t_ns=np.arange(n) * 33_000_000)


def depths(n: int = N) -> Stills:
    return Stills(depth_image, n, DEPTH, t_ns=np.arange(n) * 33_000_000 + 4_000_000)


def keyframes(
    *keys: tuple[str, int, Sequence[Sequence[float]] | Floats | None], layer: str = "a"
) -> pa.Table:
    rows: list[dict[str, object]] = []
    for name, frame, corners in keys:
        base: dict[str, object] = {
            "layer": layer,
            "object_id": name,
            "t_ns": None,
            "frame": frame,
            "dimensions": 2,
            "z": None,
        }
        if corners is None:
            rows.append(base | {"present": False, "vertex": None, "x": None, "y": None})
            continue
        rows += [
            base | {"present": True, "vertex": k, "x": float(u), "y": float(v)}
            for k, (u, v) in enumerate(corners)
        ]
    return pa.Table.from_pylist(rows, schema=KEYFRAMES.arrow)


def shapes(tracks: pa.Table, name: str = "o1") -> dict[int, Floats]:
    found: dict[int, list[tuple[float, float]]] = {}
    for row in tracks.to_pylist():
        if row["object_id"] == name:
            found.setdefault(row["frame"], []).append((row["u_px"], row["v_px"]))
    return {frame: np.array(corners) for frame, corners in found.items()}


def status(table: pa.Table) -> dict[int, str]:
    return {row["frame"]: row["status"] for row in table.to_pylist()}


def test_a_shape_drawn_once_is_in_every_later_image() -> None:
    tracks, hulls = follow_objects(keyframes(("o1", 2, BOX)), film(), depths())
    assert tracks.schema.equals(TRACKS_2D.arrow)
    assert hulls.schema.equals(HULLS.arrow)
    found = shapes(tracks)
    assert sorted(found) == list(range(2, N))
    for k, ring in found.items():
        assert np.abs(ring - moved(k)).max() < 2.5
    assert status(tracks) == {2: "drawn"} | dict.fromkeys(range(3, N), "tracked")
    assert tracks["t_ns"].to_pylist()[-1] == (N - 1) * 33_000_000


def test_the_hull_is_where_depth_sees_the_thing() -> None:
    _, hulls = follow_objects(keyframes(("o1", 0, BOX)), film(), depths())
    for k in (0, 10, N - 1):
        rows = [row for row in hulls.to_pylist() if row["frame"] == k]
        corners = np.array([[row[axis] for axis in "xyz"] for row in rows])
        assert 4 <= len(corners) <= 48
        assert corners[:, 2].max() == pytest.approx(NEAR_M, abs=0.006)
        assert corners[:, 2].min() == pytest.approx(NEAR_M - 0.045, abs=0.001)
        middle_m = (130 + shift(k) - 159.5) / 300 * NEAR_M
        assert (corners[:, 0].max() + corners[:, 0].min()) / 2 == pytest.approx(middle_m, abs=0.01)
        assert np.ptp(corners[:, 0]) == pytest.approx(0.2, abs=0.03)


def test_the_table_is_no_part_of_a_hull() -> None:
    plane = dict.fromkeys(TABLE_PLANE.arrow.names) | {"frame": 0, "n_points": 0, "n_inliers": 0}
    plane |= {"nx": 0.0, "ny": 0.0, "nz": -1.0, "d": NEAR_M, "evidence": "depth"}
    table = pa.Table.from_pylist([plane], schema=TABLE_PLANE.arrow)
    _, hulls = follow_objects(keyframes(("o1", 0, BOX)), film(), depths(), table)
    assert NEAR_M - 0.02 < np.asarray(hulls["z"]).max() < NEAR_M - 0.008


def test_a_rectangle_is_four_corners() -> None:
    tracks, _ = follow_objects(keyframes(("o1", 0, [(100, 80), (60, 50)])), film(n=3))
    np.testing.assert_array_equal(shapes(tracks)[0], BOX)
    assert np.abs(shapes(tracks)[2] - BOX).max() < 0.5


def test_an_object_drawn_as_absent_is_absent_until_it_is_drawn_again() -> None:
    later = moved(25)
    drawn = keyframes(("o1", 0, BOX), ("o1", 8, None), ("o1", 25, later))
    found = shapes(follow_objects(drawn, film())[0])
    assert sorted(found) == [*range(8), *range(25, N)]


def test_between_two_drawn_shapes_both_count() -> None:
    """The second shape was drawn larger: what is in between grows from one to the other."""
    last, grown = N - 1, np.array([[-4.0, -4], [4, -4], [4, 4], [-4, 4]])
    drawn = keyframes(("o1", 0, BOX), ("o1", last, moved(last) + grown))
    found = shapes(follow_objects(drawn, film())[0])
    assert sorted(found) == list(range(N))
    height = [np.ptp(found[k][:, 1]) for k in (0, 8, 15, 22, last)]
    assert height == pytest.approx([50, 50 + 8 * 8 / last, 50 + 8 * 15 / last, 50 + 8 * 22 / last, 58], abs=2)


def test_a_shape_begun_at_another_vertex_is_the_same_shape() -> None:
    last = N - 1
    turned = np.roll(moved(last), 2, 0)[::-1]
    found = shapes(follow_objects(keyframes(("o1", 0, BOX), ("o1", last, turned)), film())[0])
    for k in range(last):
        assert np.abs(found[k] - moved(k)).max() < 2.5


def test_a_thing_that_vanishes_is_proposed_and_then_lost() -> None:
    def gone(k: int) -> NDArray[np.uint8]:
        return color_image(k) if k < 4 else np.repeat(BEHIND[..., None], 3, 2)

    tracks, _ = follow_objects(keyframes(("o1", 0, BOX)), film(gone, 120))
    found = status(tracks)
    assert [found[k] for k in (0, 3, 4, 50)] == ["drawn", "tracked", "proposed", "proposed"]
    assert 90 < max(found) < 119
    confidence = np.asarray(tracks["confidence"])
    assert confidence[0] == 1
    assert confidence.min() < 0.02


def test_without_depth_or_calibration_there_are_tracks_but_no_hulls() -> None:
    drawn = keyframes(("o1", 0, BOX))
    for depth in (None, Stills(depth_image, N)):
        tracks, hulls = follow_objects(drawn, film(n=4), depth)
        assert tracks.num_rows == 16
        assert hulls.num_rows == 0
        assert hulls.schema.equals(HULLS.arrow)


def test_nothing_drawn_gives_empty_tables_and_reads_nothing() -> None:
    color = film()
    tracks, hulls = follow_objects(keyframes(), color, depths())
    assert (tracks.num_rows, hulls.num_rows) == (0, 0)
    assert color.asked == []


def test_images_are_read_from_the_first_drawn_on_and_in_order() -> None:
    color = film()
    follow_objects(keyframes(("o1", 20, moved(20)), ("o1", 24, None)), color)
    assert color.asked == [20, 21, 22, 23, 24]


def test_shapes_that_are_none_are_left_out() -> None:
    drawn = keyframes(
        ("point", 0, [(5, 5)]),
        ("speck", 0, [(5, 5), (1, 1)]),
        ("late", 99, BOX),
        ("missing", 0, [(1, 1), (np.nan, 3), (9, 9)]),
        ("early", -1, BOX),
    )
    assert list(drawn_shapes(drawn, np.arange(N))) == ["early"]


def test_of_two_layers_one_draws_an_object() -> None:
    both = pa.concat_tables([keyframes(("o1", 0, BOX), layer="b"), keyframes(("o1", 3, BOX), layer="a")])
    assert list(drawn_shapes(both, np.arange(N))["o1"]) == [3]


def test_a_depth_image_belongs_to_the_colour_image_nearest_in_time() -> None:
    slow = Stills(depth_image, 10, DEPTH, t_ns=np.arange(10) * 99_000_000)
    assert partners(film(n=6), slow).tolist() == [0, 0, 1, 1, 1, 2]
    late = Stills(depth_image, 10, DEPTH, t_ns=np.arange(10) * 33_000_000 + 10**9)
    assert partners(film(n=6), late).tolist() == [-1] * 6


def test_the_stage_follows_all_but_the_table() -> None:
    drawn = keyframes(("o1", 0, BOX), ("o4", 0, [(10, 150), (300, 60)]))
    images = {"color": film(n=3), "depth": depths(3)}
    made = HULL.run({"keyframes": drawn}, images, HullParameters(surface="o4"))
    assert tuple(made) == HULL.outputs
    assert set(made["tracks_2d"]["object_id"].to_pylist()) == {"o1"}
