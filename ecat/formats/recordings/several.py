"""A source with several recordings in it: a project with a session for each, in one piece."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from ecat.errors import InputError
from ecat.formats.format import ImportOptions, ImportReport
from ecat.model import ProjectManifest, Provenance
from ecat.progress import Progress
from ecat.store import staged_folder
from ecat.store.manifest import is_plain_name
from ecat.store.project import write_project_manifest

Part = tuple[str, Callable[[Path], ImportReport]]
"""The name of a session, and what writes it to the folder it is given."""


def folder_name(wanted: str, taken: set[str], *, default: str) -> str:
    """``wanted`` as any file system can have it, told apart from the names in ``taken``, to which it is added."""
    base = re.sub(r"[^\w.@+-]", "_", wanted)[:100].lstrip("._-") or default
    name, count = base, 1
    while name.lower() in taken:
        count += 1
        name = f"{base}_{count}"
    taken.add(name.lower())
    return name


def create_all(
    dest: Path,
    parts: Sequence[Part],
    *,
    format_name: str,
    source: str,
    options: ImportOptions,
    progress: Progress,
) -> ImportReport:
    """Write one part as the session ``dest``, several as sessions of the project ``dest``.

    Raises
    ------
    InputError : a part cannot be read; with ``options.keep_going``, none of them.
    StoreError : ``dest`` is taken or cannot be written; nothing is left there.
    """
    if len(parts) == 1:
        return parts[0][1](dest)
    findings: list[str] = []
    done: list[str] = []
    with staged_folder(dest) as staging:
        name = dest.resolve().name
        manifest = ProjectManifest(
            name=name if is_plain_name(name) else "project",
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            provenance=Provenance(format=format_name, source=source),
        )
        write_project_manifest(staging, manifest)
        for i, (session, write) in enumerate(parts):
            progress(session, i, len(parts))
            try:
                report = write(staging / session)
            except InputError as error:
                if not options.keep_going or (i == len(parts) - 1 and not done):
                    raise
                findings.append(f"{session} was left out: {error.what}: {error.where}")
                continue
            done.append(session)
            findings += [f"{session}: {finding}" for finding in report.findings]
    return ImportReport(path=dest, format=format_name, sessions=len(done), findings=tuple(findings))
