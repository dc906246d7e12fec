"""Are rows as :mod:`ecat.tables` declares them; the store sees to columns, types and empty cells."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow as pa

from ecat.check.finding import Finding, Patient, error, some
from ecat.tables import PUBLISHED, TABLES

VALUES: dict[str, frozenset[str]] = {
    "source": frozenset({"observed", "interpolated"}),
    "support": frozenset({"table", "free"}),
    "state": frozenset({"tracked", "inferred", "not_tracked"}),
    "evidence": frozenset(
        {
            "depth",
            *(f"{what}{more}" for what in ("polygon", "boxes", "polygon+boxes") for more in ("", "+depth")),
        }
    ),
}
"""Values of the columns that have a fixed set of them, in tables that are not published from annotations."""


def values(patient: Patient) -> Iterator[Finding]:
    """Columns with a fixed set of values have no others."""
    for name, table in _tables(patient):
        for column in sorted(VALUES.keys() & set(table.column_names)):
            used = {str(value) for value in table[column].unique().drop_null().to_pylist()}
            if wrong := sorted(used - VALUES[column]):
                allowed = ", ".join(sorted(VALUES[column]))
                message = f"column {column} has {some(wrong)}; expected {allowed}"
                yield error("table-value", f"table {name}", message)


def order(patient: Patient) -> Iterator[Finding]:
    """Time rises from row to row, as slices are found by the row groups' first and last times."""
    for name, table in _tables(patient):
        first = TABLES[name].order[0]
        if (np.diff(table[first].to_numpy()) < 0).any():
            message = f"its rows are not sorted by {first}: reading a stretch of time would miss some"
            yield error("table-unsorted", f"table {name}", message)


def _tables(patient: Patient) -> Iterator[tuple[str, pa.Table]]:
    """The tables that are not published from annotations: those cannot differ from them."""
    for name in sorted(TABLES.keys() - {schema.name for schema in PUBLISHED}):
        if (table := patient.table(name)) is not None:
            yield name, table


SCHEMA = (values, order)
