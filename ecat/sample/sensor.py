"""What a marker detector, a depth camera and a body tracker would report of the truth.

Source: ECAT 2018 file format §0.3, §0.4, §1.2.4 (order of corners and codes), §2.1 (what the detector finds).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats
from ecat.sample.body import JOINTS
from ecat.sample.truth import GroundTruth
from ecat.tables import TABLES

MIN_SIDE_PX = 32
"""A blob whose bounding box is narrower or lower is not looked at."""
BODY_SLOT = 3
# Reported numbers are multiples of these, which float32 text holds exactly and Parquet packs well.
_METRE_STEP = 2.0**-14
_PIXEL_STEP = 2.0**-7


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """How far the sensors are from the truth; one standard deviation each where not said otherwise.

    Parameters
    ----------
    corner_px : of a detected corner; ``whole_pixels`` rounds it as the old detector did.
    missed : probability that a visible face is not found.
    blur_px : way of the corners from one frame to the next at which a face is lost with probability 0.63.
    outage : probability per frame and box that the box is lost altogether; ``outage_frames``: mean length.
    depth_m, lateral_m : of a corner in space, along and across the sight line.
    depth_lost : probability that a corner has no depth.
    depth_beyond : probability that a corner has the depth of something up to 0.15 m behind it.
    joint_m, inferred_m : of a joint seen, and of one behind something.
    polygon_px, polygon_m : of the vertices of the table that a person drew, and of their mapping into space.
    """

    corner_px: float = 0.4
    whole_pixels: bool = True
    missed: float = 0.04
    blur_px: float = 40.0
    outage: float = 0.008
    outage_frames: float = 6.0
    depth_m: float = 0.003
    lateral_m: float = 0.0005
    depth_lost: float = 0.01
    depth_beyond: float = 0.01
    joint_m: float = 0.004
    inferred_m: float = 0.02
    polygon_px: float = 1.5
    polygon_m: float = 0.004


NOISELESS = NoiseModel(
    corner_px=0.0,
    whole_pixels=False,
    missed=0.0,
    blur_px=float("inf"),
    outage=0.0,
    depth_m=0.0,
    lateral_m=0.0,
    depth_lost=0.0,
    depth_beyond=0.0,
    joint_m=0.0,
    inferred_m=0.0,
    polygon_px=0.0,
    polygon_m=0.0,
)
"""Sensors that report the truth, of what they see."""


def markers(truth: GroundTruth, noise: NoiseModel, rng: np.random.Generator) -> tuple[pa.Table, pa.Table]:
    """``markers_2d`` and ``markers_3d``: the faces that a detector finds, in its order, with its errors."""
    pixels = truth.pixels + rng.normal(0, 1, truth.pixels.shape) * noise.corner_px
    pixels = _stepped(pixels, 1.0 if noise.whole_pixels else _PIXEL_STEP)
    size = np.ptp(pixels, axis=-2)
    found = _found(truth, noise, rng) & (size >= MIN_SIDE_PX).all(-1)
    inside = (pixels > 0) & (pixels < [truth.scene.color.width - 1, truth.scene.color.height - 1])
    found &= inside.all((-1, -2))
    box, frame, face, order = _rows(found, size.prod(-1))
    # in the mirrored image the print's own clockwise ring runs the other way
    ring = pixels[box, frame, face, ::-1]
    space = _stepped(_depth(truth, noise, rng, truth.corners[box, frame, face, ::-1]), _METRE_STEP)
    codes = _codes(truth)[box, face, _first(ring[..., 0] * 1e5 + ring[..., 1])]
    shared = [
        truth.t_ns[frame],
        frame.astype(np.int32),
        np.array(truth.object_ids)[box],
        order.astype(np.int16),
        np.ones(len(frame), bool),
        np.full(len(frame), 5, np.int16),
        codes,
        np.full(len(frame), None),
        np.full(len(frame), None),
    ]
    flat = _rotate(ring, ring.sum(-1) + ring[..., 0] * 1e-5)
    # least X + Y in Kinect camera space is greatest x + y here; a corner without depth comes before all
    deep = _rotate(space, np.nan_to_num(-space[..., 0] - space[..., 1], nan=-np.inf))
    return (
        _table("markers_2d", [*shared, *flat.reshape(-1, 8).T]),
        _table("markers_3d", [*shared, *deep.reshape(-1, 12).T]),
    )


def joints(truth: GroundTruth, noise: NoiseModel, rng: np.random.Generator, rig_id: str) -> pa.Table:
    """The ``joints`` table of the one performer, joints by name."""
    by_name = np.argsort(JOINTS)
    hidden = truth.joint_hidden[:, by_name]
    sigma = np.where(hidden, noise.inferred_m, noise.joint_m)[..., None]
    place = truth.scene.depth_from_table.apply(truth.joints[:, by_name])
    place = _stepped(place + rng.normal(0, 1, place.shape) * sigma, _METRE_STEP)
    pixels = truth.scene.color.project(place).reshape(-1, 2)
    n, k = hidden.shape
    return _table(
        "joints",
        [
            np.repeat(truth.t_ns, k),
            np.repeat(np.arange(n, dtype=np.int32), k),
            np.full(n * k, rig_id),
            np.full(n * k, BODY_SLOT, np.int8),
            np.tile(np.array(JOINTS)[by_name], n),
            *place.reshape(-1, 3).T,
            *_stepped(pixels, _PIXEL_STEP).T,
            np.where(hidden.ravel(), "inferred", "tracked"),
        ],
    )


def _table(name: str, columns: list[NDArray[np.generic]]) -> pa.Table:
    schema = TABLES[name].arrow
    arrays: list[pa.Array[Any]] = []
    for values, field in zip(columns, schema, strict=True):
        if pa.types.is_dictionary(field.type):
            arrays.append(pa.array(values, pa.string()).dictionary_encode())
        else:
            arrays.append(pa.array(values, field.type, from_pandas=True))
    return pa.Table.from_arrays(arrays, schema=schema)


# ----------------------------------------------------------------------------------------------- pieces


def _found(truth: GroundTruth, noise: NoiseModel, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Faces (boxes, frames, faces) in view that the detector does not miss."""
    step = np.diff(truth.pixels, axis=1, prepend=truth.pixels[:, :1])
    speed = np.sqrt((step**2).sum(-1)).mean(-1)
    kept = (1 - noise.missed) * np.exp(-speed / noise.blur_px)
    found = (truth.hidden == 0) & (rng.random(speed.shape) < kept)
    starts = rng.random(speed.shape[:2]) < noise.outage
    lengths = rng.geometric(1 / noise.outage_frames, starts.shape)
    for box, frame in zip(*np.nonzero(starts), strict=True):
        found[box, frame : frame + lengths[box, frame]] = False
    return found


def _rows(found: NDArray[np.bool_], area: Floats) -> tuple[NDArray[np.intp], ...]:
    """Box, frame, face and position in the marker of every face found, by frame, box, area descending."""
    box, frame, face = np.nonzero(found)
    by = np.lexsort((face, -area[box, frame, face], box, frame))
    box, frame, face = box[by], frame[by], face[by]
    marker = frame * len(found) + box
    order = np.arange(len(marker)) - np.searchsorted(marker, marker)
    return box, frame, face, order


def _codes(truth: GroundTruth) -> NDArray[np.str_]:
    """Codes (boxes, faces, 4) as read in the mirrored image from each corner of the reversed ring.

    The ring is bottom left, bottom right, top right, top left of the print; rows run to the next corner.
    """
    grids = [[np.array(list(face.code)).reshape(5, 5) for face in box.faces] for box in truth.prototypes]
    return np.array(
        [
            [["".join(g.ravel()) for g in (p[::-1], p[::-1, ::-1].T, p[:, ::-1], p.T)] for p in faces]
            for faces in grids
        ]
    )


def _stepped(values: Floats, step: float) -> Floats:
    return np.round(values / step) * step


def _first(key: Floats) -> NDArray[np.intp]:
    return np.argmin(key, -1)


def _rotate(ring: Floats, key: Floats) -> Floats:
    """Rings (n, 4, k) rotated to begin at their least key (n, 4)."""
    return np.take_along_axis(ring, ((_first(key)[:, None] + np.arange(4)) % 4)[..., None], 1)


def _depth(truth: GroundTruth, noise: NoiseModel, rng: np.random.Generator, corners: Floats) -> Floats:
    """Corners (n, 4, 3) of the ``table`` frame in ``camera/depth``, as mapped through depth; NaN: lost."""
    place = truth.scene.depth_from_table.apply(corners)
    eye = truth.scene.color.from_reference.inverse().translation
    ray = place - eye
    length = np.sqrt((ray**2).sum(-1, keepdims=True))
    shape = length.shape
    beyond = (rng.random(shape) < noise.depth_beyond) * rng.uniform(0.01, 0.15, shape)
    place = eye + ray * (1 + (rng.normal(0, 1, shape) * noise.depth_m + beyond) / length)
    place = place + rng.normal(0, 1, place.shape) * noise.lateral_m
    return np.where(rng.random(shape) < noise.depth_lost, np.nan, place)
