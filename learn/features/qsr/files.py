"""Relations of tracks in a Parquet file, written to another, in memory that does not grow with the tracks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.progress import Progress, silent
from ecat.store import staged_file
from learn.features.qsr.codes import MISSING, Codes, Floats, to_arrow
from learn.features.qsr.continuity import Tracks, chains, positions
from learn.features.qsr.relations import Relation
from learn.features.qsr.rows import TrackFile

LARGEST = 1e100
"""Beyond, squares of distances are no numbers any more; and nothing is that far."""


@dataclass(frozen=True)
class Written:
    """What was written: rows, tracks read, and rows in which nothing is known; and of a relation of boxes, the numbers
    of those objects that have no sizes, and so are points.
    """

    rows: int
    tracks: int
    missing: int
    points: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Values of consecutive rows, with track and frame (or place in the chain), how many rows were read for
    them, and how many tracks begin in these.
    """

    track: pa.Array[Any]
    frame: pa.Array[Any]
    codes: Codes
    read: int
    begun: int


def write_relation(
    source: Path,
    dest: Path,
    relation: Relation,
    parameters: Mapping[str, Any],
    *,
    objects: Sequence[int] = (1, 2, 3),
    collapse: bool = False,
    validate: bool = False,
    progress: Progress = silent,
) -> Written:
    """Compute a relation for all tracks of a Parquet file.

    Each row of ``source`` is one frame of one track; a frame follows the one before it in its track, whatever is
    between their numbers.  A coordinate that is null or NaN is not known.  ``dest`` is ordered by track and frame.

    Parameters
    ----------
    source : columns ``track`` (integers or text), ``frame`` (numbers), and of object k ``xk``, ``yk``, and where
        there are any ``wk``, ``hk`` (size) or, for argd, ``zk``.
    dest : columns ``track``, ``frame`` and one named after the relation, null where an object is not known; of
        chains, ``frame`` is the place in the chain, from 1.
    objects : numbers of the objects, in the order in which the relation takes them.
    collapse, validate : make chains of QTC states.

    Raises
    ------
    NotFoundError, FormatError, SchemaError : no such file, not Parquet, or columns are missing.
    InputError : a coordinate is infinite, a size negative, a frame occurs twice, or nothing is there.
    LimitError : the rows are not ordered by track and frame, and more than can be ordered in memory; or a track has
        a long name.
    ExistsError : ``dest`` is taken.
    """
    file = TrackFile(source)
    columns = [_columns_of(k, relation, file.names, objects) for k in objects[: relation.objects]]
    schema = file.schema([name for names in columns for name in names])
    stretches = _stretches(file, relation, parameters, columns)
    values = relation.values_of(parameters)
    if collapse or validate:
        stretches = _chains(stretches, values, collapse=collapse, validate=validate)
        schema = schema.set(1, pa.field("frame", pa.int32()))
    schema = schema.append(pa.field(relation.name, pa.dictionary(pa.uint8(), pa.string())))
    rows = tracks = missing = read = 0
    # without Arrow's own schema in the file, readers see names, not how they are numbered
    with (
        staged_file(dest) as staging,
        pq.ParquetWriter(staging, schema, compression="zstd", store_schema=False) as writer,
    ):
        for each in stretches:
            writer.write_table(
                pa.Table.from_arrays([each.track, each.frame, to_arrow(each.codes, values)], schema=schema)
            )
            rows, tracks, read = rows + len(each.codes), tracks + each.begun, read + each.read
            missing += int(np.count_nonzero(each.codes == MISSING))
            progress(relation.name, read, file.n_rows)
    taken = objects[: relation.objects] if relation.of_boxes else ()
    points = tuple(k for k, names in zip(taken, columns, strict=False) if f"w{k}" not in names)
    return Written(rows, tracks, missing, points)


def _columns_of(k: int, relation: Relation, there: frozenset[str], objects: Sequence[int]) -> list[str]:
    sized = relation.of_boxes and {f"w{k}", f"h{k}"} <= there
    in_space = relation.in_space and {f"z{each}" for each in objects[: relation.objects]} <= there
    return [f"x{k}", f"y{k}", *([f"w{k}", f"h{k}"] if sized else []), *([f"z{k}"] if in_space else [])]


def _stretches(
    file: TrackFile, relation: Relation, parameters: Mapping[str, Any], columns: list[list[str]]
) -> Iterator[_Stretch]:
    last: pa.Table | None = None
    for batch in file.rows([name for names in columns for name in names]):
        _require_places(file, batch)
        rows = (batch if last is None else pa.concat_tables([last, batch])).combine_chunks()
        track, frame = (rows[name].combine_chunks() for name in ("track", "frame"))
        follows = pc.equal(track[1:], track[:-1]).to_numpy(zero_copy_only=False)
        begun = int(np.count_nonzero(~follows)) + (last is None)
        if relation.frames == 1:
            codes = relation.compute(*(_places(batch, names) for names in columns), **parameters)
            yield _Stretch(
                batch["track"].combine_chunks(), batch["frame"].combine_chunks(), codes, batch.num_rows, begun
            )
        else:
            codes = relation.compute(*(_places(rows, names) for names in columns), **parameters)
            keep = pa.array(follows)
            yield _Stretch(
                track[1:].filter(keep), frame[1:].filter(keep), codes[follows], batch.num_rows, begun
            )
        last = rows.slice(rows.num_rows - 1)


def _places(rows: pa.Table, names: Sequence[str]) -> Floats:
    """(n, 2), (n, 3) or (n, 4) coordinates of one object."""
    places = np.empty((len(names), rows.num_rows))
    for row, name in zip(places, names, strict=True):
        row[:] = rows[name].to_numpy()
    return places.T


def _require_places(file: TrackFile, rows: pa.Table) -> None:
    for name in rows.column_names[2:]:
        values: NDArray[np.float64] = rows[name].to_numpy()
        wrong = np.flatnonzero((np.abs(values) > LARGEST) | ((values < 0) & (name[0] in "wh")))
        if wrong.size:
            track, frame = (rows[key][int(wrong[0])].as_py() for key in ("track", "frame"))
            where = f"track {track}, frame {frame}: {name} is {values[wrong[0]]:g}"
            fix = "write null where something was not measured, and sizes of 0 or more"
            raise file.refusal(InputError, where, fix)


def _chains(
    stretches: Iterator[_Stretch], values: tuple[str, ...], *, collapse: bool, validate: bool
) -> Iterator[_Stretch]:
    """The chain of every track; of the one that goes on in the next stretch, its last state is kept."""
    state, place, name = MISSING, 0, None
    for each in stretches:
        if not len(each.codes):
            yield _Stretch(each.track, pa.array([], pa.int32()), each.codes, each.read, each.begun)
            continue
        names = each.track[:1] if name is None else name
        track = pa.concat_arrays([names, each.track])
        new = pc.not_equal(track[1:], track[:-1]).to_numpy(zero_copy_only=False)
        ids: Tracks = np.concatenate([[0], np.cumsum(new)]).astype(np.int32)
        heads = pa.concat_arrays([names, each.track.filter(pa.array(new))])
        states = np.concatenate([np.array([state], np.uint8), each.codes])
        found, of = chains(states, ids, values, collapse=collapse, validate=validate)
        before = int(state != MISSING)  # told in the stretch before
        known = states[(ids == ids[-1]) & (states != MISSING)]
        places = positions(of) + np.where(of == 0, place - before, 0).astype(np.int32)
        at_end = places[of == ids[-1]]
        state, name = (int(known[-1]) if len(known) else MISSING), heads[len(heads) - 1 :]
        place = int(at_end[-1]) if len(at_end) else 0
        yield _Stretch(
            heads.take(pa.array(of[before:], pa.int32())),
            pa.array(places[before:]),
            found[before:],
            each.read,
            each.begun,
        )
