"""Tables of a few rows, and what Rerun would show of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk

from ecat.tables import TABLES
from ecat.view.scene import Scene, Thing, Timebase

BOX = Thing("o1", "Shell", "Shell", (10, 20, 30), (0.2, 0.2, 0.2))
PALE = (132, 137, 142)
DIM = (5, 10, 15)


def table(of: str, /, **columns: Sequence[object]) -> pa.Table:
    """The session's table ``of`` that name; what is not given is null."""
    n = len(next(iter(columns.values()))) if columns else 0
    schema = TABLES[of].arrow
    return pa.Table.from_arrays(
        [pa.array(list(columns.get(field.name, [None] * n)), type=field.type) for field in schema],
        schema=schema,
    )


def scene(n_frames: int = 10, *, step_ns: int | None = None) -> Scene:
    """One box; without ``step_ns`` there is no clock."""
    t_ns = None if step_ns is None else np.arange(n_frames + 1, dtype=np.int64) * step_ns
    return Scene(Timebase(n_frames, t_ns), {"o1": BOX})


def at(chunks: Iterable[Chunk], path: str, component: str) -> dict[int | None, Any]:
    """What the entity's ``component`` is at each frame at which something of it is sent; None: always."""
    found: dict[int | None, Any] = {}
    for chunk in chunks:
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if chunk.entity_path == path and name.endswith(f":{component}"):
                values = batch.column(name).to_pylist()
                frames = [None] * len(values) if chunk.is_static else batch.column("frame").to_pylist()
                found.update(zip(frames, values, strict=True))
    assert found, f"{path} has no {component}: {sorted({chunk.entity_path for chunk in chunks})}"
    return found


def paths(chunks: Iterable[Chunk]) -> set[str]:
    return {chunk.entity_path for chunk in chunks}
