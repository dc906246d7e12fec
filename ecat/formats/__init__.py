"""Foreign formats: recordings and annotations of other programs in, the same and data sets out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ecat.errors import ExistsError, UsageError
from ecat.formats import exporting, registry
from ecat.formats.format import ExportReport, Format, ImportOptions, ImportReport, Part, SideFile
from ecat.formats.options import read_options
from ecat.model.annotation import MACHINE
from ecat.progress import Progress, silent
from ecat.store import Session, open_session, remote
from ecat.store.manifest import is_layer_name, require_utf8

__all__ = [
    "ExportReport",
    "Format",
    "ImportOptions",
    "ImportReport",
    "Part",
    "SideFile",
    "export",
    "import_layer",
    "import_source",
    "registry",
]


def import_source(
    source: Path,
    dest: Path,
    *,
    format: str | None = None,  # noqa: A002  (the name of the option)
    skip_bad_markers: bool = False,
    keep_going: bool = False,
    progress: Progress = silent,
) -> ImportReport:
    """Turn a foreign recording into a session, project or workspace at ``dest``.

    Raises
    ------
    UsageError : unknown format, or one that is only written.
    InputError : the source cannot be read; nothing is left at ``dest``.
    StoreError : ``dest`` is taken or cannot be written; nothing is left there.
    """
    source, dest = Path(source), Path(dest)
    # both name things inside of the session; better said before an hour of video was read
    require_utf8(f"cannot import {source}", source.resolve().name, dest.resolve().name)
    registry.refuse_own(source)
    chosen = registry.find(format) if format is not None else registry.sniff(source)
    if chosen.read is None:
        raise UsageError(
            f"cannot import {source}", where=f"{chosen.name} is only written, not read", fix="ecat formats"
        )
    options = ImportOptions(skip_bad_markers=skip_bad_markers, keep_going=keep_going)
    return chosen.read(source, dest, options, progress)


def import_layer(
    source: Path,
    session: Session | Path,
    *,
    layer: str,
    format: str | None = None,  # noqa: A002  (the name of the option)
) -> ImportReport:
    """Read another program's annotations into a new layer of a session that is there.

    Raises
    ------
    UsageError : unknown format, or one that holds no annotations; ``layer`` is not a name.
    InputError : the source cannot be read, or is about other recordings; the session is as it was.
    ExistsError : there is a layer of that name; layers are never replaced by an import.
    StoreError : the session cannot be written.
    """
    source = Path(source)
    what = f"cannot import {source}"
    session = open_session(session) if isinstance(session, Path) else session
    _require_free(what, session, layer)
    chosen = registry.find(format) if format is not None else registry.sniff(source)
    if chosen.read_layer is None:
        raise UsageError(
            what,
            where=f"{chosen.name} holds no annotations of a session that is there",
            fix="import it to a new folder; ecat formats lists the formats",
        )
    made, findings = chosen.read_layer(source, session)
    with session.write() as commit:
        _require_free(what, session, layer)
        commit.put_layer(replace(made, name=layer))
    return ImportReport(path=session.path, format=chosen.name, sessions=1, findings=findings)


def _require_free(what: str, session: Session, layer: str) -> None:
    if not is_layer_name(layer):
        fix = "take letters, digits, '_', '-', '.' and spaces"
        raise UsageError(what, where=f"{layer!r:.80} is not a layer's name", fix=fix)
    if layer == MACHINE:
        where = f"layer {layer} belongs to what ecat itself proposes"
        raise UsageError(what, where=where, fix="take another name")
    if session.manifest.layer(layer) is not None:
        raise ExistsError(
            what,
            where=f"{session.path}: there is a layer {layer} already",
            consequence="it was left as it is",
            fix="take another name; ecat agree compares layers",
        )


def export(
    path: Path | str,
    dest: Path | str,
    *,
    format: str,  # noqa: A002  (the name of the option)
    options: Mapping[str, str] | None = None,
    progress: Progress = silent,
) -> ExportReport:
    """Write the session, project or workspace at ``path`` in a foreign format.

    What stops one session of several does not stop the others: it is among the ``failures`` of the report.

    Parameters
    ----------
    path, dest : paths, or URLs that fsspec knows (:mod:`ecat.store.remote`).
    options : of the format, as texts (:mod:`ecat.formats.options`).

    Raises
    ------
    UsageError : unknown format, or one that is only read; an option that the format does not have.
    StoreError : ``path`` is no session, or ``dest`` is taken or cannot be written; nothing is left there.
    """
    path, dest = remote.place_of(path), remote.place_of(dest)
    chosen = registry.find(format)
    chosen_options = read_options(chosen.options, options or {}, chosen.name)
    if chosen.part is not None:
        return exporting.write(path, dest, chosen, chosen_options, progress)
    if chosen.write is None:
        raise UsageError(
            f"cannot export {path}", where=f"{chosen.name} is only read, not written", fix="ecat formats"
        )
    if isinstance(path, str) or isinstance(dest, str):
        raise UsageError(
            f"cannot export {path} to {dest}",
            where=f"{chosen.name} is written as a whole, from folder to folder",
            fix="copy the sessions to this machine, or choose another format",
        )
    return chosen.write(path, dest, chosen_options, progress)
