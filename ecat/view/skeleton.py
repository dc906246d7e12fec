"""Skeletons: joints as points, bones as lines, in space and in the colour image."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats
from ecat.model.skeleton import BONES
from ecat.view.scene import (
    CAMERA,
    IMAGE,
    UNOBSERVED,
    Frames,
    Scene,
    Thing,
    integers,
    numbers,
    rgba,
    static,
    strips,
    temporal,
    texts,
    ui_points,
)

if TYPE_CHECKING:
    from rerun.chunk import Chunk


def skeletons(joints: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Every body of table ``joints``: in ``camera/depth``, and in the colour image where that is known."""
    objects, bodies = texts(joints, "object_id"), integers(joints, "body")
    keys = np.where(objects == "", np.char.add("body ", bodies.astype(np.str_)), objects)
    for key in np.unique(keys):
        rows, thing = joints.filter(pa.array(keys == key)), scene.thing(str(key))
        yield from _drawn(rows, thing, scene, f"{CAMERA}/skeleton/{thing.part}", "x y z")
        yield from _drawn(rows, thing, scene, f"{IMAGE}/skeleton/{thing.part}", "u_px v_px")


def joint_grid(rows: pa.Table, columns: str) -> tuple[Frames, NDArray[np.str_], Floats, NDArray[np.bool_]]:
    """One body's frames (f,), joint names (j,), positions (f, j, d), whether tracked (f, j); NaN = no row."""
    frames, at = np.unique(integers(rows, "frame"), return_inverse=True)
    names, which = np.unique(texts(rows, "joint"), return_inverse=True)
    values = numbers(rows, columns)
    positions = np.full((len(frames), len(names), values.shape[1]), np.nan)
    positions[at, which] = values
    tracked = np.zeros((len(frames), len(names)), np.bool_)
    tracked[at, which] = texts(rows, "state") == "tracked"
    return frames, names, positions, tracked


def _drawn(rows: pa.Table, thing: Thing, scene: Scene, path: str, columns: str) -> Iterator[Chunk]:
    import rerun as rr

    frames, names, positions, tracked = joint_grid(rows, columns)
    there = np.logical_and.reduce(np.isfinite(positions), axis=-1)
    if not there.any():
        return
    flat = positions.shape[-1] == 2
    points, lines = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    index = {name: i for i, name in enumerate(names.tolist())}
    pairs = [(index[a], index[b]) for a, b in BONES if a in index and b in index]
    bones = np.array(pairs, np.intp).reshape(-1, 2)
    whole = np.logical_and.reduce(there[:, bones], axis=-1)
    ends, sure = positions[:, bones][whole], np.logical_and.reduce(tracked[:, bones], axis=-1)[whole]
    # a frame without the body follows its last one: what was shown must go
    counts, bone_counts = there.sum(1), whole.sum(1)
    gone = np.setdiff1d(frames + 1, frames)
    gone = gone[gone < scene.timebase.n_frames]
    order = np.argsort(np.concatenate([frames, gone]))
    frames = np.concatenate([frames, gone])[order]
    counts, bone_counts = (np.concatenate([c, np.zeros_like(gone)])[order] for c in (counts, bone_counts))

    def colors(known: NDArray[np.bool_]) -> NDArray[np.uint32]:
        return np.where(known, rgba(thing.color), rgba(UNOBSERVED)).astype(np.uint32)

    yield static(path, points.from_fields(radii=[ui_points(2.5)]))
    joints = points.columns(positions=positions[there], colors=colors(tracked[there]))
    yield temporal(path, scene.timebase, frames, joints.partition(counts))
    yield static(f"{path}/bones", lines.from_fields(radii=[ui_points(1.5)]))
    drawn = lines.columns(strips=strips(ends), colors=colors(sure))
    yield temporal(f"{path}/bones", scene.timebase, frames, drawn.partition(bone_counts))
