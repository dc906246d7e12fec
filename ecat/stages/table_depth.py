"""The table from depth images: its plane, its outline, and from when on the camera stood elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.geometry.depth import DepthCamera, RangeNoise, color_pixels, steady
from ecat.geometry.planes import plane_frame
from ecat.geometry.standpoints import (
    LEAST_IMAGES,
    MOVED,
    STILL_SHARE,
    STILL_SHARE_OF_TABLE,
    changes,
    standpoints,
    thinned,
)
from ecat.geometry.surfaces import (
    Surface,
    near_plane,
    outline,
    plane_vector,
    resting_depth,
    surface_near,
    surfaces,
    tabletop,
)
from ecat.geometry.transforms import Floats
from ecat.stages.images import Images, ImagesByKind
from ecat.stages.stage import Stage, Tables
from ecat.tables import TABLE_OUTLINE, TABLE_PLANE

MOST_IMAGES, MOST_FOR_OUTLINE = 60, 20
"""Depth images looked at for the plane and for its outline, spread over the whole recording or a place's part of it."""
MOST_BYTES = 64_000_000
"""What they may take up together; of large images fewer are looked at."""


@dataclass(frozen=True)
class OutlineParameters:
    """``noise``: of the depth camera."""

    noise: RangeNoise = field(default_factory=RangeNoise)


@dataclass(frozen=True, eq=False)
class _Place:
    """A stretch of the recording seen from one place.

    ``index`` (n,) and ``stack`` (n, height, width) are the images looked at, ``first`` the index of the first of all.
    """

    index: NDArray[np.int64]
    stack: NDArray[np.uint16]
    first: int

    @cached_property
    def resting(self) -> NDArray[np.float64]:
        """What was mostly seen (height, width), in units of the images."""
        return resting_depth(self.stack)


@dataclass(frozen=True, eq=False)
class _Film:
    """Depth images of a camera."""

    images: Images
    camera: DepthCamera
    noise: RangeNoise

    def views(self, stack: NDArray[np.uint16], pixels: NDArray[np.intp]) -> Floats:
        """Metres (n, pixels) of some pixels of images (n, height, width)."""
        return self.camera.z(stack.reshape(len(stack), -1)[:, pixels])

    def resting(self, place: _Place) -> Floats:
        """Metres (height, width) of what was mostly seen, without flying pixels."""
        z = place.resting * self.camera.unit_m
        return np.where(steady(z), z, np.nan)


def fit_table_in_depth(
    depth: Images, believed: pa.Table | None = None, noise: RangeNoise | None = None
) -> pa.Table:
    """The table ``table_plane``: a row for every place that the camera had, each valid from its frame on.

    What is fitted is the depth that was mostly seen from a place, so that hands and whatever is moved leave no trace.
    ``n_points`` counts the pixels inside the table's outline in all images looked at, ``n_inliers`` those of them that
    lie on the plane: their ratio is how much of the table could be seen over time.  ``rms_m`` and ``max_m`` are of the
    depth mostly seen.

    Parameters
    ----------
    depth : images of a depth camera with known calibration.
    believed : a ``table_plane`` of other evidence: it tells which of the surfaces is the table.  If there is none where
        it should be, though the camera never moved, the table is not to be seen in depth, and this is what is returned.

    Raises
    ------
    InputError : no calibration, no place where the camera stood still, or no flat surface seen from there.
    """
    film = _film(depth, noise)
    places = _places(film)
    found = [_table(film.resting(place), film, believed) for place in places]
    if believed is not None and len(found) == 1 and found[0][1] == "depth":
        return believed
    rows: list[dict[str, object]] = []
    for place, (surface, evidence) in zip(places, found, strict=True):
        if surface is not None:
            coverage = _coverage(surface, outline(surface, film.camera.rays), place, film)
            rows.append(_when(depth, place.first) | _row(surface, film.camera, evidence, coverage))
    if not rows:
        raise _unfit("no flat surface in the depth images", "draw the table as a 3-D polygon")
    # whatever the first images show, the first row is about them too
    rows[0] |= {"frame": 0, "t_ns": None if rows[0]["t_ns"] is None else 0}
    return pa.Table.from_pylist(rows, schema=TABLE_PLANE.arrow)


def outline_table(depth: Images, table_plane: pa.Table, noise: RangeNoise | None = None) -> pa.Table:
    """The table ``table_outline`` of every plane in ``table_plane`` that is seen in depth while it is valid.

    Raises
    ------
    InputError : the depth camera's calibration is not known.
    """
    film = _film(depth, noise)
    planes = sorted(table_plane.to_pylist(), key=lambda row: row["frame"])
    ends = [row["frame"] for row in planes[1:]] + [np.inf]
    corners: list[dict[str, object]] = []
    for row, end in zip(planes, ends, strict=True):
        valid = np.flatnonzero((np.asarray(depth.frame) >= row["frame"]) & (np.asarray(depth.frame) < end))
        if not len(valid):
            continue
        z = film.resting(_looked_at(film, valid, MOST_FOR_OUTLINE))
        surface = surface_near(*_own_plane(row, film.camera), z, film.camera.rays, film.noise)
        if surface is None:
            continue
        for k, corner in enumerate(_in_reference(outline(surface, film.camera.rays), film.camera).tolist()):
            corners.append(
                {
                    "frame": row["frame"],
                    "t_ns": row["t_ns"],
                    "vertex": k,
                    **dict(zip("xyz", corner, strict=True)),
                }
            )
    return pa.Table.from_pylist(corners, schema=TABLE_OUTLINE.arrow)


def _film(depth: Images, noise: RangeNoise | None) -> _Film:
    if depth.camera is None:
        raise _unfit("the depth camera's calibration is not known", "give the session a camera for its depth")
    return _Film(depth, DepthCamera(depth.camera, depth.unit_m), noise or RangeNoise())


def _unfit(where: str, fix: str) -> InputError:
    return InputError(
        "cannot fit the table's plane to depth", where=where, consequence="depth was not used", fix=fix
    )


def _looked_at(film: _Film, among: NDArray[np.intp], most: int) -> _Place:
    """At ``most`` so many images, spread evenly over those with the indices ``among`` (n,)."""
    size = film.camera.rays[..., 0].size
    most = int(np.clip(MOST_BYTES // (2 * size), 12, most))
    index = among[np.unique(np.linspace(0, len(among) - 1, min(most, len(among))).round().astype(int))]
    stack = np.array(list(film.images.read(index.tolist())), np.uint16)
    return _Place(index, stack, int(index[0]))


def _places(film: _Film) -> list[_Place]:
    """The places of the camera, one after the other: first those far apart, then those that differ for the table."""
    if not len(film.images):
        raise _unfit("there is no depth image", "ecat check")
    whole = _looked_at(film, np.arange(len(film.images)), MOST_IMAGES)
    if not whole.stack.any():
        raise _unfit("nothing was measured in the depth images", "draw the table as a 3-D polygon")
    places = _split(film, whole, thinned(np.ones(whole.stack.shape[1:], bool)), STILL_SHARE)
    if not places:
        where = f"{len(whole.index)} images, no {LEAST_IMAGES} in succession from the same place"
        raise _unfit(where, "record with the camera at rest")
    return [part for place in places for part in _split_by_table(film, place)]


def _split_by_table(film: _Film, place: _Place) -> list[_Place]:
    surface = tabletop(surfaces(film.resting(place), film.camera.rays, film.noise))
    if surface is None:
        return [place]
    return _split(film, place, thinned(surface.mask), STILL_SHARE_OF_TABLE) or [place]


def _split(film: _Film, place: _Place, pixels: NDArray[np.intp], share: float) -> list[_Place]:
    """The places within a stretch of the recording, by the change of some pixels."""
    views = film.views(place.stack, pixels)
    parts: list[_Place] = []
    for found in standpoints(changes(views, views, film.noise, share)):
        if len(found.members) == len(place.index):
            return [place]
        start = int(found.members[0])
        first = place.first
        if parts:
            before, after = int(place.index[start - 1]), int(place.index[start])
            first = _first_image(film, views[found.members[:5]], pixels, share, (before, after))
        parts.append(_Place(place.index[found.members], place.stack[found.members], first))
    return parts


def _first_image(
    film: _Film, views: Floats, pixels: NDArray[np.intp], share: float, between: tuple[int, int]
) -> int:
    """The first image of a place, between one that is not yet from there and one that is."""
    before, after = between
    while after - before > 1:
        middle = (before + after) // 2
        view = film.views(np.array(list(film.images.read([middle]))), pixels)
        if np.median(changes(view, views, film.noise, share)) < MOVED:
            after = middle
        else:
            before = middle
    return after


def _table(z: Floats, film: _Film, believed: pa.Table | None) -> tuple[Surface | None, str]:
    """The table among the surfaces of an image, and what says so."""
    for row in believed.to_pylist() if believed is not None else []:
        surface = surface_near(*_own_plane(row, film.camera), z, film.camera.rays, film.noise)
        if surface is not None:
            return surface, f"{row['evidence']}+depth"
    return tabletop(surfaces(z, film.camera.rays, film.noise)), "depth"


def _own_plane(row: Mapping[str, Any], camera: DepthCamera) -> tuple[Floats, float]:
    """The plane of a row of ``table_plane`` in the depth camera's own frame."""
    place = camera.camera.from_reference
    normal = place.rotation @ np.array([row["nx"], row["ny"], row["nz"]])
    return normal, float(row["d"] - normal @ place.translation)


def _coverage(surface: Surface, ring: Floats, place: _Place, film: _Film) -> tuple[int, int]:
    """Pixels inside the outline in all images, and those of them on the plane."""
    camera = film.camera
    seen_at = color_pixels(_in_reference(ring, camera), camera.camera)
    region = np.zeros(place.stack.shape[1:], np.uint8)
    cv2.fillPoly(region, [np.rint(seen_at).astype(np.int32)], 1)
    inside = region > 0
    vector, rays = plane_vector(surface), camera.rays[inside]
    seen = sum(
        int(near_plane(vector, camera.z(image[inside]), rays, film.noise, 4.0).sum()) for image in place.stack
    )
    return int(inside.sum()) * len(place.stack), seen


def _in_reference(points: Floats, camera: DepthCamera) -> Floats:
    """Points (n, 3) in the camera's own frame -> in the frame of the session's points."""
    return camera.camera.from_reference.inverse().apply(points)


def _when(depth: Images, index: int) -> dict[str, object]:
    return {
        "frame": int(depth.frame[index]),
        "t_ns": None if depth.t_ns is None else int(depth.t_ns[index]),
    }


def _row(
    surface: Surface, camera: DepthCamera, evidence: str, coverage: tuple[int, int]
) -> dict[str, object]:
    place = camera.camera.from_reference
    normal = place.rotation.T @ surface.normal
    offset = surface.offset + float(surface.normal @ place.translation)
    frame = plane_frame(normal, offset)
    row: dict[str, object] = {"d": offset, "rms_m": surface.rms_m, "max_m": surface.max_m}
    row |= {"n_points": coverage[0], "n_inliers": coverage[1], "evidence": evidence}
    row |= dict(zip(("nx", "ny", "nz"), normal.tolist(), strict=True))
    row |= dict(zip(("origin_x", "origin_y", "origin_z"), frame.translation.tolist(), strict=True))
    return row | dict(zip(("qx", "qy", "qz", "qw"), frame.quaternion.tolist(), strict=True))


def _run(tables: Tables, images: ImagesByKind, parameters: OutlineParameters) -> dict[str, pa.Table]:
    return {"table_outline": outline_table(images["depth"], tables["table_plane"], parameters.noise)}


OUTLINE = Stage(
    name="outline",
    version=2,
    inputs=("table_plane",),
    images=("depth",),
    outputs=("table_outline",),
    parameters=OutlineParameters,
    run=_run,
)
