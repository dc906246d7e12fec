"""Questions to all sessions of a project at once, in SQL."""

from __future__ import annotations

from ecat.query.database import Answer, TableHelp, ask, tables_at
from ecat.query.files import write_answer

__all__ = ["Answer", "TableHelp", "ask", "tables_at", "write_answer"]
