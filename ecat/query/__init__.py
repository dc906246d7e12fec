"""Questions to all sessions of a project at once, in SQL."""

from __future__ import annotations

from ecat.query.database import Answer, Database, TableHelp, open_database, rows_of, tables_at
from ecat.query.files import write_answer
from ecat.query.plots import plot_statistics
from ecat.query.statistics import Statistics, statistics

__all__ = [
    "Answer",
    "Database",
    "Statistics",
    "TableHelp",
    "open_database",
    "plot_statistics",
    "rows_of",
    "statistics",
    "tables_at",
    "write_answer",
]
