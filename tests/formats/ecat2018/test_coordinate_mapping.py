"""From depth pixels to colour pixels by the table shipped with ECAT."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ecat.errors import FormatError, UsageError
from ecat.formats.ecat2018.coordinate_mapping import (
    CoordinateMapping,
    read_coordinate_mapping,
    write_coordinate_mapping,
)
from ecat.geometry.cameras import KINECT_V2_COLOR, KINECT_V2_DEPTH

tables = arrays(np.float32, (2, 3, 4, 2), elements=st.floats(0.5, 1900, width=32))


@pytest.fixture(scope="module")
def real_path(shared: Path) -> Path:
    return shared / "ecat_program" / "coordinateMapping.dat"


@pytest.fixture(scope="module")
def real(real_path: Path) -> CoordinateMapping:
    return read_coordinate_mapping(real_path)


def test_the_real_file_comes_back_byte_for_byte(real_path: Path, real: CoordinateMapping) -> None:
    assert write_coordinate_mapping(real) == real_path.read_bytes()


def test_the_tables_are_turned_from_columns_to_rows(real: CoordinateMapping) -> None:
    """Trap: entry (x, y) of the file is at x * 424 + y."""
    assert real.near_px.shape == real.far_px.shape == (424, 512, 2)
    assert (real.near_mm, real.far_mm) == (500, 8000)
    assert (np.diff(real.far_px[:423, :511, 0], axis=1) > 0).all()
    assert (np.diff(real.far_px[:423, :511, 1], axis=0) > 0).all()


def test_the_last_row_and_column_are_unknown_not_pixel_zero(real: CoordinateMapping) -> None:
    """Trap: they are zeros in the file, which sends their points to the corner of the colour image."""
    assert np.isnan(real.near_px[423]).all()
    assert np.isnan(real.near_px[:, 511]).all()
    assert np.isfinite(real.near_px[:423, :511]).all()
    assert np.isnan(real.to_colour(511, 10, 1000)).all()


def test_the_centre_ray_and_the_parallax(real: CoordinateMapping) -> None:
    np.testing.assert_allclose(real.to_colour(252, 203, 8000), [940.1, 542.8], atol=0.05)
    shift = real.to_colour(252, 203, 1000) - real.to_colour(252, 203, 2000)
    np.testing.assert_allclose(shift, [56_231 * (1 / 1000 - 1 / 2000), 0], rtol=0.01, atol=0.01)


def test_trap_08_the_depth_camera_s_centre_is_where_the_sensor_has_it(real: CoordinateMapping) -> None:
    """Offline ECAT took 252.7 px for its horizontal centre, which puts everything 30 colour pixels aside."""
    v_px, u_px = np.mgrid[60:360:20, 60:450:20].reshape(2, -1)
    rays = KINECT_V2_DEPTH.unproject(np.stack([u_px, v_px], axis=1))
    for depth_m in (1.0, 1.5, 2.5):
        there = real.to_colour(u_px, v_px, np.full(u_px.size, 1000 * depth_m))
        off = np.median(KINECT_V2_COLOR.project(rays * depth_m) - there, axis=0)
        assert (np.abs(off) < 5).all()


def test_at_the_table_depths_the_tables_themselves_come_out(real: CoordinateMapping) -> None:
    v, u = np.mgrid[0:423:7, 0:511:7]
    np.testing.assert_allclose(real.to_colour(u, v, 500), real.near_px[v, u], atol=1e-3)
    np.testing.assert_allclose(real.to_colour(u, v, 8000), real.far_px[v, u], atol=1e-3)


def test_no_depth_and_pixels_outside_have_no_colour(real: CoordinateMapping) -> None:
    """Trap: ECAT dropped these by dividing by zero."""
    found = real.to_colour([10, -1, 10, 600], [10, 10, 424, 10], [0, 900, 900, 900])
    assert found.shape == (4, 2)
    assert np.isnan(found).all()


@given(tables, st.integers(1, 1000), st.integers(1, 1000))
def test_reading_a_written_mapping_gives_it_back(
    both: NDArray[np.float32], near_mm: int, range_mm: int
) -> None:
    mapping = CoordinateMapping(both[0], both[1], near_mm, near_mm + range_mm)
    again = read_coordinate_mapping(write_coordinate_mapping(mapping))
    np.testing.assert_array_equal(again.near_px, both[0])
    np.testing.assert_array_equal(again.far_px, both[1])
    assert (again.near_mm, again.far_mm) == (mapping.near_mm, mapping.far_mm)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "shorter than the header"),
        (struct.pack("<4i", 0, 424, 500, 8000), "0 x 424 pixels"),
        (struct.pack("<4i", -1, -1, 500, 8000), "-1 x -1 pixels"),
        (struct.pack("<4i", 2, 2, 8000, 500) + bytes(64), "at 8000 and 500 mm"),
        (struct.pack("<4i", 2, 2, 500, 8000) + bytes(63), "79 bytes, expected 80"),
        (struct.pack("<4i", 32768, 32768, 500, 8000), "expected 17,179,869,200"),
    ],
)
def test_impossible_files_are_refused(data: bytes, told: str) -> None:
    with pytest.raises(FormatError) as error:
        read_coordinate_mapping(data)
    assert told in error.value.where


def test_tables_of_different_size_are_not_written() -> None:
    with pytest.raises(UsageError):
        write_coordinate_mapping(CoordinateMapping(np.zeros((2, 2, 2), "f4"), np.zeros((2, 3, 2), "f4")))
