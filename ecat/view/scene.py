"""What every part of the view shares: time, names, colours, the way from Arrow columns to Rerun chunks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import LimitError
from ecat.geometry.boxes import boxes_by_codes
from ecat.geometry.transforms import Floats
from ecat.model import Manifest
from ecat.model.prototype import BoxPrototype, Triple

if TYPE_CHECKING:
    from rerun import ComponentColumnList, TimeColumn
    from rerun.chunk import Chunk

    from ecat.store import Session

Frames: TypeAlias = NDArray[np.int64]
Rgb: TypeAlias = tuple[int, int, int]

WORLD = "/world"
CAMERA = "/world/camera"
IMAGE = "/world/camera/color"
"""What is in pixels of the colour image hangs below its camera: so Rerun can project boxes into the image."""

# Amber and grey are missing on purpose: they say `lifted` and `not observed` wherever something is drawn.
# Any two stay apart when they are made paler, and all are bright enough for words on the dark background.
PALETTE: tuple[Rgb, ...] = (
    (77, 171, 247),
    (247, 120, 186),
    (105, 219, 124),
    (177, 151, 252),
    (255, 107, 107),
    (56, 217, 200),
    (210, 230, 90),
    (180, 15, 255),
    (0, 135, 105),
    (0, 105, 255),
    (255, 210, 240),
    (180, 90, 0),
    (225, 0, 135),
    (105, 165, 0),
    (150, 90, 180),
    (255, 60, 255),
)
MAX_FRAMES = 1_000_000
"""The longest recording that is shown, nine hours at 30 frames per second; a viewer holds all of it in memory."""
_TOO_LARGE = 1e30
FREE: Rgb = (255, 179, 0)
UNOBSERVED: Rgb = (134, 142, 150)


@dataclass(frozen=True)
class Timebase:
    """The session's clock: when each image of the annotated video was taken.

    Parameters
    ----------
    n_frames : number of images; frame ``n_frames`` is the end of the recording.
    t_ns : (n_frames + 1,) nanoseconds since the session's start, or None where the session has no clock.
    """

    n_frames: int
    t_ns: NDArray[np.int64] | None = None

    def indexes(self, frames: Frames, t_ns: NDArray[np.int64] | None = None) -> list[TimeColumn]:
        """Rerun's time columns for these frames: ``frame``, and ``session_time`` where there is a clock.

        ``t_ns`` are the times (rows,) of what has a time of its own; without, each row has its frame's.
        """
        import rerun as rr

        frames = np.clip(frames, 0, self.n_frames)
        columns = [rr.TimeColumn("frame", sequence=frames)]
        if self.t_ns is not None:
            times = self.t_ns[frames] if t_ns is None else t_ns
            columns.append(rr.TimeColumn("session_time", duration=times.astype("timedelta64[ns]")))
        return columns

    def frames_at(self, t_ns: NDArray[np.int64]) -> Frames:
        """The image on show at each time; without a clock, the times' own order."""
        if self.t_ns is None:
            return np.arange(len(t_ns))
        return np.clip(np.searchsorted(self.t_ns, t_ns, side="right") - 1, 0, self.n_frames)


@dataclass(frozen=True)
class Thing:
    """An annotated object as it is drawn: ``part`` is its name as part of an entity path."""

    id: str
    part: str
    name: str
    color: Rgb
    size_m: Triple | None = None


@dataclass(frozen=True)
class Scene:
    """The clock and the objects; what a table is drawn with."""

    timebase: Timebase
    things: Mapping[str, Thing] = field(default_factory=dict[str, Thing])

    def thing(self, object_id: str) -> Thing:
        """The object, or one made up for rows whose object nobody declared."""
        found = self.things.get(object_id)
        return found or Thing(object_id, entity_part(object_id), object_id, PALETTE[0])


def entity_part(name: str) -> str:
    """``name`` as one readable part of an entity path: blanks become underscores, the rest is escaped."""
    import rerun as rr

    return rr.escape_entity_path_part(re.sub(r"\s+", "_", name.strip()) or "_")


def scene(session: Session) -> Scene:
    """Read what the whole view shares from the session's manifest and small tables."""
    manifest = session.manifest
    frames, objects, marks = (
        session.table(name).to_arrow() if session.has_table(name) else None
        for name in ("frames", "objects", "markers_2d")
    )
    sizes = box_sizes(marks, manifest) if marks is not None else {}
    return Scene(timebase(manifest, frames), things(objects, sizes) if objects is not None else {})


def timebase(manifest: Manifest, frames: pa.Table | None) -> Timebase:
    """The clock of the annotated video (:class:`ecat.model.Clock`).

    A recorded clock comes from ``frames``; times that it misses are interpolated, its end is one median step
    after the last image.

    Raises
    ------
    LimitError : more than ``MAX_FRAMES`` frames.
    """
    n = _bounded(manifest.n_frames)
    if manifest.clock.rule == "recorded" and frames is not None and frames.num_rows:
        named = texts(frames, "stream")
        color = next(
            (s.name for s in manifest.streams if s.kind == "color" and s.name in set(named)), min(named)
        )
        mine = frames.filter(pa.array(named == color))
        at, t = integers(mine, "frame"), integers(mine, "t_ns")
        n = _bounded(max(n, int(at.max()) + 1))
        step = float(np.median(np.diff(t) / np.maximum(np.diff(at), 1))) if len(t) > 1 else 0.0
        at, t = np.append(at, n), np.append(t, t[-1] + (n - at[-1]) * step)
        return Timebase(n, np.interp(np.arange(n + 1), at, t).round().astype(np.int64))
    times = manifest.clock.times_ns(range(n + 1), n)
    known = [t for t in times if t is not None]
    return Timebase(n, np.array(known, np.int64) if len(known) == len(times) else None)


def _bounded(n_frames: int) -> int:
    if n_frames <= MAX_FRAMES:
        return n_frames
    raise LimitError(
        "cannot show the session",
        where=f"{n_frames:,} frames, at most {MAX_FRAMES:,} can be shown",
        consequence="nothing was shown or written",
        fix=f"cut the recording into sessions of at most {MAX_FRAMES:,} frames",
    )


def box_sizes(markers_2d: pa.Table, manifest: Manifest) -> dict[str, Triple]:
    """Edge lengths of each object's box, metres: those of the prototype that most of its codes belong to."""
    prototypes = [BoxPrototype.from_dict(data) for data in manifest.prototypes]
    mirrored = any(camera.mirrored for camera in manifest.cameras)
    pairs, counts = np.unique(
        np.stack([texts(markers_2d, "object_id"), texts(markers_2d, "code")]), axis=1, return_counts=True
    )
    seen = dict(zip(zip(*pairs.tolist(), strict=True), counts.tolist(), strict=True))
    found = boxes_by_codes(seen, prototypes, mirrored=mirrored)
    return {object_id: box.size_m for object_id, box in found.items()}


def things(objects: pa.Table, sizes: Mapping[str, Triple]) -> dict[str, Thing]:
    """The objects of all layers (the first layer decides on an id), boxes with their ``sizes``."""
    found: dict[str, Thing] = {}
    taken: set[str] = set()
    for row in objects.select(["object_id", "name"]).to_pylist():
        object_id: str = row["object_id"]
        if object_id in found:
            continue
        name = row["name"].strip() or object_id
        part = entity_part(name)
        if part in taken:
            part = entity_part(f"{name}_{object_id}")
        taken.add(part)
        color = PALETTE[len(found) % len(PALETTE)]
        found[object_id] = Thing(object_id, part, name, color, sizes.get(object_id))
    return found


# --- Arrow columns as arrays


def numbers(table: pa.Table, names: str) -> Floats:
    """The named columns as (rows, columns) floats, NaN where null."""
    columns = [table.column(name).to_numpy() for name in names.split()]
    return np.stack(columns, -1).astype(float).reshape(table.num_rows, len(columns))


def integers(table: pa.Table, name: str) -> Frames:
    """A column without nulls as (rows,) integers."""
    return table.column(name).to_numpy().astype(np.int64)


def texts(table: pa.Table, name: str) -> NDArray[np.str_]:
    """A column of strings (rows,), empty where null."""
    column = table.column(name)
    if not pa.types.is_dictionary(column.type):
        return np.array([value or "" for value in column.to_pylist()], dtype=np.str_)
    coded: Any = column.unify_dictionaries().combine_chunks()
    names = np.array([*coded.dictionary.to_pylist(), ""], dtype=np.str_)
    return names[coded.indices.fill_null(len(names) - 1).to_numpy(zero_copy_only=False)]


def finite(values: Floats) -> NDArray[np.bool_]:
    """Which rows (rows,) of ``values`` (rows, ...) have no number that is missing, or too large for Rerun's float32."""
    return np.logical_and.reduce(np.abs(values) < _TOO_LARGE, axis=tuple(range(1, values.ndim)))


def by_object(table: pa.Table) -> Iterable[tuple[str, pa.Table]]:
    """The rows of each object, in the order of the objects' ids."""
    ids = texts(table, "object_id")
    for object_id in np.unique(ids):
        yield str(object_id), table.filter(pa.array(ids == object_id))


# --- chunks


def rows_per_frame(frames: Frames, n_frames: int) -> tuple[Frames, NDArray[np.int64]]:
    """Which frames to send and how many of the rows belong to each, for sorted ``frames`` (rows,).

    A frame without rows that follows one with rows is sent with a count of 0: it ends what was shown before.
    """
    at, counts = np.unique(frames, return_counts=True)
    ends = np.setdiff1d(at + 1, at)
    ends = ends[ends < n_frames]
    order = np.argsort(np.concatenate([at, ends]))
    return np.concatenate([at, ends])[order], np.concatenate([counts, np.zeros_like(ends)])[order]


def strips(points: Floats) -> Any:
    """Polylines (n, vertices, 2 or 3) as Rerun's Arrow array; its own conversion takes them one by one."""
    n, k, dimensions = points.shape
    flat = pa.array(points.astype(np.float32).reshape(-1))
    vertex = pa.list_(pa.field("item", pa.float32(), nullable=False), dimensions)
    strip = pa.list_(pa.field("item", vertex, nullable=False))
    vertices = pa.FixedSizeListArray.from_arrays(flat, type=vertex)
    return pa.ListArray.from_arrays(pa.array(np.arange(n + 1) * k, pa.int32()), vertices, type=strip)


def rgba(color: Rgb, alpha: int = 255) -> int:
    """A colour as the number 0xRRGGBBAA."""
    return (color[0] << 24) | (color[1] << 16) | (color[2] << 8) | alpha


def ui_points(width: float) -> float:
    """A radius that looks the same from near and far: Rerun takes negative ones as points of the screen."""
    return -width


def pale(color: Rgb) -> Rgb:
    """Half way to white: what was measured, beside what was concluded from it."""
    r, g, b = ((channel + 255) // 2 for channel in color)
    return r, g, b


def dim(color: Rgb) -> Rgb:
    """Half way to black: what nobody drew, between what was drawn."""
    r, g, b = (channel // 2 for channel in color)
    return r, g, b


def temporal(
    path: str,
    timebase: Timebase,
    frames: Frames,
    columns: ComponentColumnList,
    t_ns: NDArray[np.int64] | None = None,
) -> Chunk:
    """What the entity shows from each of ``frames`` on, or from times ``t_ns`` of its own."""
    from rerun.chunk import Chunk

    return Chunk.from_columns(path, timebase.indexes(frames, t_ns), columns)


def static(path: str, archetype: Any) -> Chunk:
    """What the entity always shows."""
    from rerun.chunk import Chunk

    batches = archetype.as_component_batches()
    return Chunk.from_columns(path, [], [b.partition([len(b.as_arrow_array())]) for b in batches])
