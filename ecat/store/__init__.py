"""The session folder on disk: create, open, read, commit.

    my_session/
      session.json                    the manifest: everything but the rows
      media/                          recorded files as they are
      tables/<name>.parquet           long tables, and the annotations for queries
      annotations/<layer>.xml         what a person said
      annotations/<layer>.journal.jsonl
 Every change is one atomic commit (:mod:`ecat.store.transaction`), one writer at a time
(:mod:`ecat.store.lock`).
"""

from __future__ import annotations

from ecat.store.aside import set_aside
from ecat.store.commit import Commit
from ecat.store.integrity import (
    Fault,
    adopt_edited_layers,
    begin_journal,
    layer_from_journal,
    leftovers,
    rebuild_layer,
    remove_leftovers,
    validate,
)
from ecat.store.journal import HeldJournal, Journal, Place
from ecat.store.manifest import manifest_schema, project_schema
from ecat.store.output import staged_file, write_new_file
from ecat.store.parquet import TableData
from ecat.store.project import Project, create_project, find_sessions, open_project, write_project_manifest
from ecat.store.session import Draft, Session, create_session, fill_session, open_session
from ecat.store.staging import staged_folder
from ecat.store.table_view import TableView

__all__ = [
    "Commit",
    "Draft",
    "Fault",
    "HeldJournal",
    "Journal",
    "Place",
    "Project",
    "Session",
    "TableData",
    "TableView",
    "adopt_edited_layers",
    "begin_journal",
    "create_project",
    "create_session",
    "fill_session",
    "find_sessions",
    "layer_from_journal",
    "leftovers",
    "manifest_schema",
    "open_project",
    "open_session",
    "project_schema",
    "rebuild_layer",
    "remove_leftovers",
    "set_aside",
    "staged_file",
    "staged_folder",
    "validate",
    "write_new_file",
    "write_project_manifest",
]
