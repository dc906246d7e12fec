"""Annotations in COCO's form from the tables of a session, some frames at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.formats.interchange.shapes import area_of, box_around, label_of
from ecat.model import AnnotatedObject, Layer
from ecat.model.skeleton import BONES
from ecat.store import Session

Annotation: TypeAlias = dict[str, object]
Thing: TypeAlias = "tuple[AnnotatedObject, Iterator[tuple[int, Annotation]], Category]"
"""An object, its annotations by frame, and its category."""
_FRAMES_AT_ONCE = 1 << 14
_SEEN = {"tracked": 2, "inferred": 1}
"""COCO's visibility of a key point; 0 where there is none."""


@dataclass(frozen=True, slots=True)
class Category:
    """A category: its name, and the key points that things of it have."""

    name: str
    keypoints: tuple[str, ...] = ()

    def to_dict(self, number: int) -> dict[str, object]:
        """As it is written; bones are pairs of key points counted from 1."""
        said: dict[str, object] = {"id": number, "name": self.name, "supercategory": ""}
        if self.keypoints:
            at = {name: n for n, name in enumerate(self.keypoints, 1)}
            bones = [[at[a], at[b]] for a, b in BONES if a in at and b in at]
            said |= {"keypoints": list(self.keypoints), "skeleton": bones}
        return said


def box_annotation(box: Sequence[float]) -> Annotation:
    """An annotation of an upright rectangle ``u, v, width, height``."""
    u, v, width, height = (round(float(x), 6) for x in box)
    return {"bbox": [u, v, width, height], "area": round(width * height, 6), "segmentation": []}


def with_tables(session: Session, layer: Layer, drawn: Sequence[Thing]) -> list[Thing]:
    """The objects of a layer that were drawn, and those that tables tell of; what was tracked stands for what was
    drawn.
    """
    found = {thing.id: (thing, annotations, category) for thing, annotations, category in drawn}
    for thing in layer.objects:
        if _tells(session, "tracks_2d", thing.id):
            category = Category(label_of(thing))
            found[thing.id] = (thing, _tracked(session, thing.id), category)
        elif thing.id not in found and _tells(session, "markers_2d", thing.id):
            category = Category(label_of(thing))
            found[thing.id] = (thing, _faces(session, thing.id), category)
        elif thing.kind == "rig" and (joints := _joints(session, thing.id)):
            category = Category(thing.semantic_type or "person", joints)
            found[thing.id] = (thing, _bodies(session, thing.id, joints), category)
    return [found[thing.id] for thing in layer.objects if thing.id in found]


def _pieces(session: Session, table: str, thing: str, columns: Sequence[str]) -> Iterator[pa.Table]:
    """The rows of an object, some frames at a time."""
    left, start = session.table(table).num_rows, 0
    while left > 0 and start < 1 << 31:
        view = session.table(table, start_frame=start, end_frame=start + _FRAMES_AT_ONCE)
        rows = view.to_arrow()
        left, start = left - rows.num_rows, start + _FRAMES_AT_ONCE
        mine = rows.filter(pc.equal(rows["object_id"].cast(pa.string()), pa.scalar(thing)))
        if mine.num_rows:
            yield mine.select([*columns])


def _tells(session: Session, table: str, thing: str) -> bool:
    return session.has_table(table) and next(_pieces(session, table, thing, ["frame"]), None) is not None


def _by_frame(rows: pa.Table) -> Iterator[tuple[int, slice]]:
    """Frame and rows of each frame; rows are in the order of frames."""
    frames: NDArray[np.int32] = np.asarray(rows["frame"])
    if len(frames):
        edges = np.flatnonzero(np.diff(frames, prepend=frames[0] - 1, append=frames[-1] + 1))
        for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            yield int(frames[first]), slice(first, last)


def _numbers(rows: pa.Table, names: str) -> NDArray[np.float64]:
    return np.column_stack(
        [rows[name].to_numpy(zero_copy_only=False).astype(float) for name in names.split()]
    )


def _tracked(session: Session, thing: str) -> Iterator[tuple[int, Annotation]]:
    for rows in _pieces(session, "tracks_2d", thing, ["frame", "u_px", "v_px"]):
        vertices = _numbers(rows, "u_px v_px")
        for frame, mine in _by_frame(rows):
            yield from _polygons(frame, [vertices[mine].ravel()])


def _faces(session: Session, thing: str) -> Iterator[tuple[int, Annotation]]:
    names = " ".join(f"u{n}_px v{n}_px" for n in range(4))
    for rows in _pieces(session, "markers_2d", thing, ["frame", *names.split()]):
        corners = _numbers(rows, names)
        for frame, mine in _by_frame(rows):
            yield from _polygons(frame, list(corners[mine]))


def _polygons(frame: int, parts: Sequence[NDArray[np.float64]]) -> Iterator[tuple[int, Annotation]]:
    """An annotation of all parts that are known."""
    known: list[list[float]] = [
        [round(x, 6) for x in part.tolist()] for part in parts if np.isfinite(part).all() and len(part) >= 6
    ]
    if known:
        said = box_annotation(box_around([x for part in known for x in part]))
        area = round(sum(area_of(part) for part in known), 6)
        yield frame, {**said, "segmentation": known, "area": area}


def _joints(session: Session, thing: str) -> tuple[str, ...]:
    """The names of the joints that a body has anywhere in the image."""
    if not session.has_table("joints"):
        return ()
    names: dict[str, None] = {}
    for rows in _pieces(session, "joints", thing, ["joint", "u_px"]):
        column: Any = rows["joint"].filter(pa.array(np.isfinite(_numbers(rows, "u_px")[:, 0])))
        names |= dict.fromkeys(column.cast(pa.string()).unique().to_pylist())
    return tuple(sorted(names))


def _bodies(session: Session, thing: str, joints: Sequence[str]) -> Iterator[tuple[int, Annotation]]:
    at = {name: n for n, name in enumerate(joints)}
    for rows in _pieces(session, "joints", thing, ["frame", "joint", "u_px", "v_px", "state"]):
        places = _numbers(rows, "u_px v_px")
        names: list[Any] = rows["joint"].cast(pa.string()).to_pylist()
        states = rows["state"].cast(pa.string()).to_pylist()
        for frame, mine in _by_frame(rows):
            points = np.zeros((len(joints), 3))
            for i in range(mine.start, mine.stop):
                seen = _SEEN.get(states[i] or "tracked", 0)
                if seen and np.isfinite(places[i]).all():
                    points[at[names[i]]] = (*np.round(places[i], 6), seen)
            there = points[points[:, 2] > 0]
            if len(there):
                flat = [int(x) if n % 3 == 2 else x for n, x in enumerate(points.ravel().tolist())]
                box = box_annotation(box_around(there[:, :2].ravel().tolist()))
                yield frame, {**box, "keypoints": flat, "num_keypoints": len(there)}
