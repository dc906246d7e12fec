"""What a table's schema is made of, and the columns that many tables share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pyarrow as pa

SCHEMA_VERSION = 1
ROW_GROUP_ROWS = 65_536

NAME = pa.dictionary(pa.int32(), pa.string())


@dataclass(frozen=True, slots=True)
class Column:
    """One column: Arrow type, what it means, its unit and frame of reference, and whether it may be null."""

    name: str
    type: pa.DataType
    meaning: str
    unit: str = ""
    reference: str = ""
    nullable: bool = False


@dataclass(frozen=True, slots=True)
class TableSchema:
    """One table: its columns, in order, and the columns that its rows are sorted by."""

    name: str
    meaning: str
    columns: tuple[Column, ...]
    order: tuple[str, ...] = ()

    @property
    def arrow(self) -> pa.Schema:
        """The Arrow schema, each field with its meaning, unit and reference as metadata."""
        return _arrow(self)

    def to_dict(self) -> dict[str, object]:
        """The schema as JSON-able data."""
        return {
            "name": self.name,
            "schema_version": SCHEMA_VERSION,
            "meaning": self.meaning,
            "order": list(self.order),
            "columns": [
                {
                    "name": c.name,
                    "type": str(c.type),
                    "nullable": c.nullable,
                    "unit": c.unit,
                    "reference": c.reference,
                    "meaning": c.meaning,
                }
                for c in self.columns
            ],
        }


@cache
def _arrow(schema: TableSchema) -> pa.Schema:
    return pa.schema(
        [
            pa.field(
                c.name,
                c.type,
                nullable=c.nullable,
                metadata={"meaning": c.meaning, "unit": c.unit, "reference": c.reference},
            )
            for c in schema.columns
        ],
        metadata={"ecat.table": schema.name, "ecat.schema_version": str(SCHEMA_VERSION)},
    )


T_NS = Column(
    "t_ns", pa.int64(), "time since the session's start; null where the session has no clock", "ns", "", True
)
FRAME = Column("frame", pa.int32(), "image of the annotated video, from zero")
OBJECT = Column("object_id", NAME, "the annotated object")
LAYER = Column("layer", NAME, "the annotation layer")
EVENT = Column("event_id", pa.string(), "the event")
INTERVAL = (
    Column("start_frame", pa.int32(), "first image of the interval"),
    Column("end_frame", pa.int32(), "first image after the interval; null: to the end", "", "", True),
    Column("start_ns", pa.int64(), "start of the interval", "ns", "", True),
    Column("end_ns", pa.int64(), "end of the interval", "ns", "", True),
)


def numbers(names: str, meaning: str, unit: str, reference: str) -> tuple[Column, ...]:
    """Columns of numbers that may be null; ``meaning`` is said of each of the ``names``."""
    return tuple(
        Column(name, pa.float64(), f"{meaning}: {name}", unit, reference, nullable=True)
        for name in names.split()
    )
