"""How fast the session folder is: every figure beside what it is measured against, in the same run.

``python benchmarks/store.py``
"""

from __future__ import annotations

import io
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.model import AnnotatedObject, Clock, Event, Layer, Manifest, Segment
from ecat.store import Draft, Session, TableData, create_session, open_session, snapshot
from ecat.tables import TABLES

N_FRAMES = 100_000
N_OBJECTS = 3
N_MARKS = 7_000
SLICE_S = 30.0
FPS = 30


def best(work: Callable[[], object], times: int = 15) -> float:
    """The shortest of some runs, in milliseconds: what the machine can do when nothing else disturbs it."""
    durations: list[float] = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        durations.append(time.perf_counter() - start)
    return 1000 * min(durations)


def table(name: str, n_frames: int, per_frame: int) -> pa.Table:
    """Rows like those of a recording: slow movement with a little noise, few names."""
    chance = np.random.default_rng(0)
    n = n_frames * per_frame
    columns: list[Any] = []
    for field in TABLES[name].arrow:
        if field.name == "t_ns":
            columns.append(pa.array(np.repeat(np.arange(n_frames) * 1_000_000_000 // FPS, per_frame)))
        elif field.name == "frame":
            columns.append(pa.array(np.repeat(np.arange(n_frames, dtype=np.int32), per_frame)))
        elif pa.types.is_dictionary(field.type):
            words = pa.array([f"{field.name}{i}" for i in range(per_frame)])
            columns.append(
                pa.DictionaryArray.from_arrays(np.tile(np.arange(per_frame, dtype=np.int32), n_frames), words)
            )
        elif pa.types.is_floating(field.type):
            path = np.cumsum(chance.normal(0, 1e-3, (n_frames, per_frame)), axis=0)
            # marks are whole pixels, or were written with seven digits; poses have all their digits
            columns.append(pa.array((path if name == "poses" else np.round(path, 3)).ravel()))
        elif pa.types.is_boolean(field.type):
            columns.append(pa.array(np.ones(n, dtype=bool)))
        elif pa.types.is_integer(field.type):
            columns.append(pa.array(np.ones(n, dtype=np.int16)).cast(field.type))
        else:
            columns.append(pa.nulls(n, field.type))
    return pa.table(columns, schema=TABLES[name].arrow)


def manifest(n_frames: int) -> Manifest:
    """A session of so many frames."""
    clock = Clock(rule="uniform", duration_ns=(n_frames - 1) * 1_000_000_000 // FPS)
    return Manifest(name="benchmark", created="2020-01-01T00:00:00", n_frames=n_frames, clock=clock)


class Counted(io.FileIO):
    """A file that counts the bytes read from it."""

    total = 0

    def read(self, size: int | None = -1, /) -> bytes:
        """Read, and count."""
        data = super().read(-1 if size is None else size)
        Counted.total += len(data)
        return data


def bytes_read(session: Session, **bounds: float) -> int:
    """How many bytes of the poses a read takes."""
    usual = snapshot.open_source
    snapshot.open_source = lambda path: pa.PythonFile(Counted(path), mode="r")
    Counted.total = 0
    session.table("poses", start=bounds.get("start"), end=bounds.get("end")).to_arrow()
    snapshot.open_source = usual
    return Counted.total


def reading(folder: Path) -> None:
    """Opening and slicing a long session."""
    poses = table("poses", N_FRAMES, N_OBJECTS)
    made = Draft(manifest=manifest(N_FRAMES), tables={"poses": TableData(data=poses)})
    path = create_session(folder / "long", made).path
    file = path / "tables" / "poses.parquet"
    start = time.perf_counter()
    session = open_session(path)
    first = 1000 * (time.perf_counter() - start)
    middle = N_FRAMES / FPS / 2
    whole = best(lambda: pq.read_table(file), 7)
    opened = best(lambda: open_session(path), 50)
    part = best(lambda: session.table("poses", start=middle, end=middle + SLICE_S).to_arrow())
    frame = best(lambda: session.table("poses", start=middle, end=middle + SLICE_S).to_pandas())
    read_whole, read_part = bytes_read(session), bytes_read(session, start=middle, end=middle + SLICE_S)
    megabytes = file.stat().st_size / 1e6
    print(f"session of {N_FRAMES} frames, {poses.num_rows} poses, {megabytes:.1f} MB of Parquet")
    line("baseline: pyarrow reads the whole table", whole, f"{read_whole / 1e6:.2f} MB")
    line("open_session", opened, f"{whole / opened:.0f} x faster; the first time {first:.2f} ms")
    line(f"{SLICE_S:.0f} s of poses, Arrow", part, f"{whole / part:.1f} x faster; {read_part / 1e6:.2f} MB")
    line(f"{SLICE_S:.0f} s of poses, pandas", frame, f"{whole / frame:.1f} x faster")


def creating(folder: Path) -> None:
    """Writing a session as an import does."""
    frames = N_MARKS // N_OBJECTS
    tables = {name: TableData(data=table(name, frames, N_OBJECTS)) for name in ("markers_2d", "markers_3d")}
    events = tuple(Event(id=f"e{i}", segments=(Segment(start_frame=i, end_frame=i + 9),)) for i in range(10))
    layer = Layer(objects=(AnnotatedObject(id="o1", kind="marker_box"),), events=events)
    made = Draft(manifest=manifest(frames), layers=(layer,), tables=tables)
    dest = folder / "short"
    contents = [p.read_bytes() for p in sorted(create_session(dest, made).path.rglob("*")) if p.is_file()]

    def create() -> None:
        shutil.rmtree(dest)
        create_session(dest, made)

    def plain_copy() -> None:
        shutil.rmtree(dest)
        (dest / "tables").mkdir(parents=True)
        for i, content in enumerate(contents):
            with (dest / "tables" / str(i)).open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())

    def commit() -> None:
        with session.write() as change:
            change.put_layer(layer)

    created = best(create)
    control = best(plain_copy)
    shutil.rmtree(dest)
    session = create_session(dest, made)
    committed = best(commit)
    marks, size = frames * N_OBJECTS, sum(map(len, contents)) / 1e3
    print(f"session of 2 x {marks} marks, 7 published tables: {size:.0f} kB in {len(contents)} files")
    line("baseline: write and sync the same bytes", control, "")
    line("create_session", created, f"{created / control:.1f} x the baseline")
    line("a commit of one layer and what follows", committed, f"{committed / control:.1f} x the baseline")


def line(what: str, milliseconds: float, remark: str) -> None:
    """Print one figure."""
    print(f"  {what:42} {milliseconds:8.2f} ms   {remark}")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        reading(Path(temporary))
        creating(Path(temporary))
