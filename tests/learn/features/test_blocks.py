"""Blocks on the table by one marker, as the program of chapter 5 placed them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ecat.errors import InputError
from learn.features.blocks import EDGE_M, complete_corner, project_block, table_axes

Floats = NDArray[np.float64]
LEVEL = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
"""A table seen from above, in axes whose z is up."""
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.04


def best_by_frame(corners: Floats, frame: NDArray[np.int64], n: int) -> Floats:
    """Of the markers of a frame the one of which most numbers are known, and of equals the largest."""
    known = np.where(np.isfinite(corners), corners, 0.0)
    x, y = known[..., 0], known[..., 1]
    area = np.abs((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1))
    order = np.lexsort((area, np.isfinite(corners).sum(axis=(1, 2))))
    found = np.full((n, 4, 3), np.nan)
    found[frame[order]] = corners[order]
    return found


def test_places_equal_those_that_were_stored(shared: Path) -> None:
    folder = shared / "demonstrations_ch5" / "demonstrations"
    if not folder.is_dir():
        pytest.skip("demonstrations_ch5 is not in the reference data")
    names = dict.fromkeys(("action", "session", "object"), "str")
    marks, frames = (
        pq.read_table(folder / f"{name}.parquet").to_pandas().astype(names)
        for name in ("markers_3d", "frames_2d")
    )
    columns = [f"{axis}{corner}" for corner in range(4) for axis in "xyz"]
    polygons = {
        (one["action"], one["session"]): one["table_polygons"][str(one["table_frame_used"])]
        for one in json.loads((folder / "sessions.json").read_text("utf-8"))
    }
    by_block = dict(iter(marks.groupby(["action", "session", "object"])))
    compared = 0
    for key, rows in frames.groupby(["action", "session", "object"]):
        action, session, name = (str(each) for each in key)
        table = table_axes(np.array(polygons[action, session], np.float64))
        seen = by_block[action, session, name]
        corners = seen[columns].to_numpy(np.float64).reshape(-1, 4, 3)
        found = project_block(best_by_frame(corners, seen["frame"].to_numpy(), len(rows)), table)
        stored = rows.sort_values("frame")
        observed = stored["observed"].to_numpy()
        assert (np.isfinite(found).all(axis=1) == observed).all(), key
        off = np.abs(found - stored[["x", "y", "rotation"]].to_numpy())[observed]
        assert off[:, :2].max() < 1e-4, key
        assert np.minimum(off[:, 2], np.pi / 2 - off[:, 2]).max() < 1e-3, key
        compared += len(off)
    assert compared > 40_000


@given(st.floats(-0.5, 1.5), st.floats(-0.5, 1.5), st.floats(0, 1.5), st.floats(0, 0.3))
def test_a_marker_on_top_is_where_its_block_is(x: float, y: float, turned: float, height: float) -> None:
    cos, sin = np.cos(turned), np.sin(turned)
    marker = SQUARE @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + np.array([x, y, height])
    ((u, v, rotation),) = project_block(marker[None], table_axes(LEVEL))
    assert (u, v) == pytest.approx((x, y), abs=1e-9)
    off = abs(rotation - turned)
    assert min(off, np.pi / 2 - off) == pytest.approx(0, abs=1e-9)


def test_from_a_marker_on_a_side_the_block_is_behind_it() -> None:
    # x to the right, y up, z away from the camera; the table is level
    table = table_axes(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]))
    marker = SQUARE + np.array([0.3, 0.08, 0.5])
    ((u, v, rotation),) = project_block(marker[None], table)
    assert (u, abs(v)) == pytest.approx((0.3, 0.5 + EDGE_M / 2))
    assert min(rotation, np.pi / 2 - rotation) == pytest.approx(0, abs=1e-9)


def test_one_missing_corner_is_found_and_two_are_not() -> None:
    for missing in range(4):
        holed = SQUARE.copy()
        holed[missing, 2] = np.inf
        assert complete_corner(holed[None])[0] == pytest.approx(SQUARE)
    holed = np.where(np.arange(4)[:, None] < 2, np.nan, SQUARE)
    assert np.isnan(project_block(holed[None], table_axes(LEVEL))).all()


def test_a_table_of_two_corners_is_refused() -> None:
    with pytest.raises(InputError, match="table"):
        table_axes(np.array([[0, 0, 0], [1, 0, 0], [np.nan] * 3]))
