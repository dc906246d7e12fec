"""Small processed sessions, with more or less in them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ecat.model import AnnotatedObject, Stream
from ecat.process import process_session
from ecat.sample import sample_session
from ecat.store import Draft, Session, TableData, create_session, open_session
from ecat.tables import FRAMES

SHELL, STELLA = "o2", "o3"
Change = Callable[[pa.Table], pa.Table]


def draft(**changes: Change) -> Draft:
    """A performer who slides one box next to the other; tables changed by name."""
    made = sample_session(seed=3, actions=("next",), name="slide")[0]
    tables = dict(made.tables)
    for name, change in changes.items():
        data = tables[name].data
        assert isinstance(data, pa.Table)
        tables[name] = TableData(data=change(data))
    return replace(made, tables=tables)


def make(folder: Path, made: Draft, *, process: bool = True) -> Session:
    create_session(folder, made)
    if process:
        process_session(folder, stages=["plane", "pose"])
    return open_session(folder)


def without(made: Draft, *names: str) -> Draft:
    return replace(made, tables={name: table for name, table in made.tables.items() if name not in names})


def with_times(made: Draft, t_ns: np.ndarray[Any, np.dtype[np.int64]], lost: Collection[int] = ()) -> Draft:
    """Its images were recorded at these times, but for those that are lost."""
    video = Stream(name="color", kind="color", file="media/color.mp4", present=False, n_frames=len(t_ns))
    rows = [
        dict.fromkeys(FRAMES.arrow.names) | {"stream": "color", "frame": frame, "t_ns": time}
        for frame, time in enumerate(t_ns.tolist())
        if frame not in lost
    ]
    clock = replace(made.manifest.clock, rule="recorded")
    return replace(
        made,
        manifest=replace(made.manifest, streams=(video,), clock=clock),
        tables={**made.tables, "frames": TableData(data=pa.Table.from_pylist(rows, schema=FRAMES.arrow))},
    )


def only(object_id: str) -> Change:
    return lambda table: table.filter(pc.field("object_id").cast(pa.string()) == object_id)


def until(frame: int) -> Change:
    return lambda table: table.filter(pc.field("frame") < frame)


def without_people(made: Draft) -> Draft:
    """Only the boxes were annotated."""
    layer = made.layers[0]
    boxes = tuple(thing for thing in layer.objects if thing.kind == "marker_box")
    return replace(made, layers=(replace(layer, objects=boxes, events=(), relations=()),))


def with_a_third(made: Draft) -> Draft:
    """A third box stands far away, with the marker that the first has in the first frame, moved."""
    data = made.tables["markers_3d"].data
    assert isinstance(data, pa.Table)
    one = only(SHELL)(data).slice(0, 1).to_pylist()[0]
    n = made.manifest.n_frames or 0
    rows = [
        one
        | {"object_id": "o9", "frame": frame, "t_ns": None}
        | {f"x{k}": one[f"x{k}"] + 1.5 for k in range(4)}
        for frame in range(n)
    ]
    table = pa.concat_tables([data, pa.Table.from_pylist(rows, schema=data.schema)]).sort_by("frame")
    layer = made.layers[0]
    thing = AnnotatedObject(id="o9", name="Corona", kind="marker_box", origin="tracked", dimensions=3)
    return replace(
        made,
        layers=(replace(layer, objects=(*layer.objects, thing)),),
        tables={**made.tables, "markers_3d": TableData(data=table)},
    )


def lost(joint: str) -> Change:
    return lambda table: table.filter(pc.field("joint").cast(pa.string()) != joint)


def known(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Share of points that are known."""
    return float(np.isfinite(points).all(axis=-1).mean())
