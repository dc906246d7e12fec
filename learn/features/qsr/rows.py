"""Rows of tracks in a Parquet file, in the order of track and frame, a bounded number at a time."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.errors import EcatError, FormatError, InputError, LimitError, SchemaError, os_error

ROWS = 1 << 18
"""Rows in memory at a time."""
MOST_UNORDERED = 30_000_000
"""Rows that are ordered in memory, at about 60 bytes each."""
MOST_NAME, MOST_NAMES = 255, 1 << 31
"""Bytes of the name of a track, as of a file; and of all that are ordered in memory, as the file has them."""
_PAGE = 1 << 20
"""Bytes that a column may have beyond its values."""


class TrackFile:
    """A Parquet file with a row for every frame of every track.

    Parameters
    ----------
    path : columns ``track`` (integers or text) and ``frame`` (numbers), each pair once, and others of numbers.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if path.exists() and not path.is_file():
            raise self.refusal(FormatError, "not a file", "name a Parquet file")
        with self._reading():
            metadata = pq.read_metadata(path)
            paths = {metadata.schema.column(place).path for place in range(metadata.num_columns)}
            # names of tracks are kept once
            self._file = pq.ParquetFile(path, metadata=metadata, read_dictionary=list({"track"} & paths))
            self.names = frozenset(self._file.schema_arrow.names)
        self.n_rows = self._file.metadata.num_rows
        if not self.n_rows:
            raise self.refusal(InputError, "no rows", "give at least one track")

    def schema(self, numbers: Sequence[str]) -> pa.Schema:
        """The columns ``track`` and ``frame``, after a look at the types of all that are needed.

        Raises
        ------
        SchemaError : columns are missing, or are not of numbers.
        """
        schema, needed = self._file.schema_arrow, ("track", "frame", *numbers)
        if missing := [name for name in needed if schema.names.count(name) != 1]:
            there = ", ".join(schema.names[:20])
            where = f"there is no column {', '.join(missing)}, or more than one; there are {there}"
            raise self.refusal(SchemaError, where, "name the columns so, each once")
        track = schema.field("track").type
        if pa.types.is_dictionary(track):
            track = track.value_type
        wrong = [] if _is_name(track) else [f"track is {track}"]
        kinds = {name: schema.field(name).type for name in needed[1:]}
        wrong += [f"{name} is {kind}" for name, kind in kinds.items() if not _is_number(kind)]
        if pa.types.is_float16(kinds["frame"]):  # Arrow does not compare these
            wrong.append(f"frame is {kinds['frame']}")
        if wrong:
            fix = (
                "write tracks as integers or text, everything else as numbers, and frames not as half floats"
            )
            raise self.refusal(SchemaError, "; ".join(wrong), fix)
        return pa.schema([("track", track), ("frame", schema.field("frame").type)])

    def rows(self, numbers: Sequence[str]) -> Iterator[pa.Table]:
        """Rows in order, ``track`` and ``frame`` as they are, and ``numbers`` as float64, NaN where null.

        Raises
        ------
        InputError : a track or frame is null, or occurs twice.
        LimitError : too many rows to put in order, or a track with a long name.
        """
        schema = self.schema(numbers)
        for group, size in self._name_sizes():
            if size > (MOST_NAME + 8) * group + _PAGE:
                raise self._long_name(size // group)
        fields = [*schema, *(pa.field(name, pa.float64()) for name in numbers)]
        tables = (
            self._batches(schema.names + list(numbers))
            if self._is_ordered(schema)
            else self._ordered(numbers)
        )
        for table in tables:
            yield table.cast(pa.schema(fields), safe=False)

    def refusal(self, kind: type[EcatError], where: str, fix: str) -> EcatError:
        """The error about this file."""
        return kind(
            f"cannot read {self.path.name}",
            where=f"{self.path}: {where}",
            consequence="nothing was computed",
            fix=fix,
        )

    def _batches(self, names: list[str]) -> Iterator[pa.Table]:
        with self._reading():
            for batch in self._file.iter_batches(ROWS, columns=names):
                self._require_names(batch.column("track"))
                yield pa.Table.from_batches([batch]).select(names)

    def _is_ordered(self, schema: pa.Schema) -> bool:
        """Whether tracks and frames ascend; refuses what is null or stands beside its like."""
        last: pa.Table | None = None
        ordered = True
        for batch in self._batches(schema.names):
            table = batch.cast(schema)
            for name in schema.names:
                self._require_known(table, name)
            rows = (table if last is None else pa.concat_tables([last, table])).combine_chunks()
            track, frame = (rows[name].combine_chunks() for name in schema.names)
            same = pc.equal(track[1:], track[:-1])
            self._refuse_twice(rows, pc.and_(same, pc.equal(frame[1:], frame[:-1])))
            later = pc.if_else(same, pc.greater(frame[1:], frame[:-1]), pc.greater(track[1:], track[:-1]))
            ordered &= pc.all(later, min_count=0).as_py()
            last = rows.slice(rows.num_rows - 1)
        return ordered

    def _ordered(self, numbers: Sequence[str]) -> Iterator[pa.Table]:
        fix = "write the file in the order of track and frame; then it may have any length"
        if self.n_rows > MOST_UNORDERED:
            where = (
                f"{self.n_rows:,} rows that are not ordered by track and frame; at most {MOST_UNORDERED:,}"
            )
            raise self.refusal(LimitError, where, fix)
        if (size := sum(size for _, size in self._name_sizes())) > MOST_NAMES:
            where = f"rows that are not ordered by track and frame, with {size:,} bytes of names of tracks"
            raise self.refusal(LimitError, f"{where}; at most {MOST_NAMES:,}", fix)
        with self._reading():
            tracks, names = self._track_numbers()
            frame = self._column("frame")
            order = np.lexsort((frame, tracks)).astype(np.int32)
            columns: dict[str, NDArray[Any]] = {"track": tracks[order], "frame": frame[order]}
            del tracks, frame
            twice = (np.diff(columns["track"]) == 0) & (np.diff(columns["frame"]) == 0)
            if twice.any():
                row = int(np.argmax(twice))
                raise self._twice(names[int(columns["track"][row])].as_py(), columns["frame"][row].item())
            for name in numbers:
                columns[name] = self._column(name, pa.float64())[order]
        for start in range(0, self.n_rows, ROWS):
            part = {name: values[start : start + ROWS] for name, values in columns.items()}
            tracks = names.take(pa.array(part.pop("track"), pa.int32()))
            yield pa.Table.from_pydict({"track": tracks, **part})

    def _track_numbers(self) -> tuple[NDArray[np.int32], pa.Array[Any]]:
        """Of every row the place of its track among all, in order; and all."""
        track: Any = self._file.read(["track"])["track"]
        if not pa.types.is_dictionary(track.type):
            track = track.dictionary_encode()
        known = track.unify_dictionaries().combine_chunks()
        names: pa.Array[Any] = known.dictionary
        order = pc.sort_indices(names)
        rank = np.argsort(order.to_numpy()).astype(np.int32)
        return rank[known.indices.to_numpy(zero_copy_only=False)], names.take(order)

    def _column(self, name: str, kind: pa.DataType | None = None) -> NDArray[Any]:
        """One column whole, without holding it twice."""
        kind = kind or self._file.schema_arrow.field(name).type
        values = np.empty(self.n_rows, kind.to_pandas_dtype())
        start = 0
        for batch in self._file.iter_batches(ROWS, columns=[name]):
            values[start : start + len(batch)] = (
                batch.column(0).cast(kind, safe=False).to_numpy(zero_copy_only=False)
            )
            start += len(batch)
        return values

    def _name_sizes(self) -> Iterator[tuple[int, int]]:
        """Of each group of rows how many they are, and the bytes of their tracks before they were compressed."""
        for number in range(self._file.metadata.num_row_groups):
            group = self._file.metadata.row_group(number)
            columns = (group.column(place) for place in range(group.num_columns))
            sizes = (one.total_uncompressed_size for one in columns if one.path_in_schema == "track")
            yield group.num_rows, sum(sizes)

    def _require_names(self, track: Any) -> None:
        """Names of tracks are text, and short."""
        if pa.types.is_dictionary(track.type):
            track.validate(full=True)
            longest = pc.max(pc.binary_length(track.dictionary)).as_py() or 0
            if longest > MOST_NAME:
                raise self._long_name(longest)

    def _long_name(self, size: int) -> EcatError:
        where = f"a track whose name has {size:,} bytes; at most {MOST_NAME}"
        return self.refusal(LimitError, where, "give tracks short names, or numbers")

    def _require_known(self, table: pa.Table, name: str) -> None:
        column = table[name].combine_chunks()
        unknown = pc.is_null(column, nan_is_null=True)
        if pc.any(unknown).as_py():
            row = pc.index(unknown, True).as_py()
            beside = "frame" if name == "track" else "track"
            where = f"{name} is null where {beside} is {table[beside][row].as_py()}"
            raise self.refusal(InputError, where, f"give every row a {name}")

    def _refuse_twice(self, rows: pa.Table, twice: pa.Array[Any]) -> None:
        if pc.any(twice).as_py():
            row = pc.index(twice, True).as_py()
            track, frame = (rows[name][row].as_py() for name in ("track", "frame"))
            raise self._twice(track, frame)

    def _twice(self, track: object, frame: object) -> EcatError:
        where = f"track {track}, frame {frame} occurs more than once"
        return self.refusal(InputError, where, "keep one row of each frame")

    @contextmanager
    def _reading(self) -> Generator[None]:
        try:
            yield
        except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
            if isinstance(error, OSError) and error.errno:
                raise os_error(error, f"cannot read {self.path.name}", self.path) from error
            said = str(error).splitlines()
            reason = said[0] if said else type(error).__name__
            raise self.refusal(FormatError, reason, "give a Parquet file that is not damaged") from None


def _is_name(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_string(kind))


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))
