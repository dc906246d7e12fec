"""The table's plane and outline from rendered depth, and from when on the camera stood elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid, matrix_from_rotvec
from ecat.sample import GroundTruth, sample_session
from ecat.sample.pixels import Renderer
from ecat.sample.scene import TABLE_OUTLINE_M
from ecat.stages.plane import PLANE, PlaneParameters, fit_table
from ecat.stages.table_depth import OUTLINE, fit_table_in_depth, outline_table
from ecat.tables import TABLE_OUTLINE, TABLE_PLANE
from tests.stages.stills import Stills

SIZE = (256, 212)
TURNS = {"nod": [0.087, 0, 0], "shake": [0, 0.087, 0], "roll": [0, 0, 0.087], "a little": [0.01, 0, 0]}


@pytest.fixture(scope="module")
def truth() -> GroundTruth:
    return sample_session(seed=1, actions=["next"])[1]


@pytest.fixture(scope="module")
def renderer(truth: GroundTruth) -> Renderer:
    return Renderer(truth, seed=1, depth_size=SIZE, texture="clutter")


@pytest.fixture(scope="module")
def film(truth: GroundTruth, renderer: Renderer) -> Callable[..., Stills]:
    """Depth of the session, later on from elsewhere, every image rendered once."""
    kept: dict[tuple[int, str], NDArray[np.uint16]] = {}

    def make(turn: str = "", start: int = 101) -> Stills:
        elsewhere = Renderer(moved(truth, turn), seed=1, depth_size=SIZE, texture="clutter") if turn else None

        def image(k: int) -> NDArray[np.uint16]:
            seen, key = (renderer, "") if elsewhere is None or k < start else (elsewhere, turn)
            if (k, key) not in kept:
                kept[k, key] = seen.depth(k)
            return kept[k, key]

        return Stills(image, truth.n_frames, renderer.cameras["depth"], t_ns=truth.t_ns)

    return make


def moved(truth: GroundTruth, turn: str) -> GroundTruth:
    rotation = Rigid(matrix_from_rotvec(np.array(TURNS[turn])), np.zeros(3))
    scene = replace(truth.scene, depth_from_table=rotation @ truth.scene.depth_from_table)
    return replace(truth, scene=scene)


def off(row: dict[str, float], table: Rigid) -> tuple[float, float]:
    """Degrees, and millimetres in the middle of the working area."""
    normal = np.array([row["nx"], row["ny"], row["nz"]])
    cosine = np.clip(normal @ table.rotation[:, 2], -1, 1)
    return float(np.degrees(np.arccos(cosine))), float(1000 * abs(normal @ table.translation + row["d"]))


def test_depth_alone_gives_the_plane(truth: GroundTruth, film: Callable[..., Stills]) -> None:
    plane = fit_table_in_depth(film())
    assert plane.schema.equals(TABLE_PLANE.arrow)
    (row,) = plane.to_pylist()
    angle, height_mm = off(row, truth.scene.depth_from_table)
    assert angle < 0.1
    assert height_mm < 2
    assert row["evidence"] == "depth"
    assert (row["frame"], row["t_ns"]) == (0, 0)
    assert row["rms_m"] < 0.001
    # the rest of it is hidden by cubes and hands now and then
    assert 0.75 < row["n_inliers"] / row["n_points"] < 0.98


@pytest.mark.parametrize("turn", TURNS)
def test_a_camera_that_moved_has_a_plane_before_and_one_after(
    truth: GroundTruth, film: Callable[..., Stills], turn: str
) -> None:
    before, after = fit_table_in_depth(film(turn)).to_pylist()
    assert before["frame"] == 0
    assert after["frame"] == 101
    assert after["t_ns"] == truth.t_ns[101]
    for row, scene in ((before, truth.scene), (after, moved(truth, turn).scene)):
        angle, height_mm = off(row, scene.depth_from_table)
        assert angle < 0.1
        assert height_mm < 2


def test_somebody_before_the_camera_is_no_move(film: Callable[..., Stills]) -> None:
    clear = film()

    def image(k: int) -> NDArray[np.uint16]:
        seen = clear.make(k).copy()
        if 60 <= k < 90:
            seen[:, : 200 + k % 7] = 700 + 9 * (k % 11)
        return seen

    plane = fit_table_in_depth(Stills(image, clear.n, clear.camera))
    assert plane["frame"].to_pylist() == [0]
    assert plane["t_ns"].to_pylist() == [None]


def test_few_images_are_looked_at_and_few_more_to_find_the_move(film: Callable[..., Stills]) -> None:
    images = film("nod")
    fit_table_in_depth(images)
    assert len(images.asked) < 70


def test_what_is_believed_tells_which_surface_is_meant(
    truth: GroundTruth, film: Callable[..., Stills]
) -> None:
    """A polygon a centimetre off is corrected; one on the floor makes the floor the table."""
    table = truth.scene.depth_from_table
    for height, expected in ((0.01, 0.0), (-0.75, -0.74)):
        drawn = table.apply(TABLE_OUTLINE_M + np.array([0, 0, height]))
        (row,) = fit_table_in_depth(film(), fit_table(drawn)).to_pylist()
        assert row["evidence"] == "polygon+depth"
        assert off(row, Rigid(table.rotation, table.apply(np.array([0, 0, expected]))))[1] < 4


def test_what_depth_does_not_show_stays_believed(truth: GroundTruth, film: Callable[..., Stills]) -> None:
    drawn = truth.scene.depth_from_table.apply(TABLE_OUTLINE_M + np.array([0, 0, 0.3]))
    believed = fit_table(drawn)
    assert fit_table_in_depth(film(), believed).equals(believed)


def test_the_outline_is_the_tables(truth: GroundTruth, film: Callable[..., Stills]) -> None:
    images = film()
    ring = outline_table(images, fit_table_in_depth(images))
    assert ring.schema.equals(TABLE_OUTLINE.arrow)
    corners = np.stack([np.asarray(ring[axis]) for axis in "xyz"], -1)
    there = truth.scene.depth_from_table.inverse().apply(corners)
    assert np.abs(there[:, 2]).max() < 0.003
    for corner in TABLE_OUTLINE_M:
        assert np.linalg.norm(there - corner, axis=1).min() < 0.08
    assert area(there) == pytest.approx(area(TABLE_OUTLINE_M[::-1]), rel=0.08)


def area(ring: Floats) -> float:
    """Square metres of a polygon (n, 3) seen from above; positive if it runs anticlockwise."""
    x, y = ring[:, 0], ring[:, 1]
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize(
    ("camera", "fill", "where"),
    [(False, 1000, "calibration"), (True, 0, "nothing was measured"), (True, None, "same place")],
)
def test_depth_that_shows_no_table_is_refused(camera: bool, fill: int | None, where: str) -> None:
    known = Camera("depth", 64, 48, fx=60.0, fy=60.0, cx=31.5, cy=23.5) if camera else None

    def image(k: int) -> NDArray[np.uint16]:
        random = np.random.default_rng(k).integers(500, 4000, (48, 64))
        return np.full((48, 64), fill, np.uint16) if fill is not None else random.astype(np.uint16)

    with pytest.raises(InputError, match=where):
        fit_table_in_depth(Stills(image, 10, known))


def test_the_plane_stage_uses_depth_if_it_is_there(film: Callable[..., Stills]) -> None:
    images = film()
    made = PLANE.run({}, {"depth": images}, PlaneParameters())
    assert made["table_plane"]["evidence"].to_pylist() == ["depth"]
    outline = OUTLINE.run(made, {"depth": images}, OUTLINE.parameters())
    assert tuple(outline) == OUTLINE.outputs


def test_without_any_evidence_the_plane_stage_says_what_is_missing_of_depth() -> None:
    nothing = Stills(lambda _: np.zeros((48, 64), np.uint16), 5, None)
    with pytest.raises(InputError, match="calibration"):
        PLANE.run({}, {"depth": nothing}, PlaneParameters())


def test_useless_depth_leaves_what_is_known_otherwise(truth: GroundTruth) -> None:
    points = truth.scene.depth_from_table.apply(TABLE_OUTLINE_M)
    columns = {axis: pa.array(points[:, i]) for i, axis in enumerate("xyz")}
    names = {"object_id": ["o5"] * 4, "dimensions": [3] * 4, "vertex": list(range(4))}
    keyframes = pa.table({**{k: pa.array(v) for k, v in names.items()}, **columns})
    nothing = Stills(lambda _: np.zeros((48, 64), np.uint16), 5, None)
    made = PLANE.run({"keyframes": keyframes}, {"depth": nothing}, PlaneParameters())
    without = PLANE.run({"keyframes": keyframes}, {}, PlaneParameters())
    assert made["table_plane"].equals(without["table_plane"])
    assert made["table_plane"]["evidence"].to_pylist() == ["polygon"]
