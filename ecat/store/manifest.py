"""``session.json`` and ``project.json``: the manifests of :mod:`ecat.model.session` as JSON.
 What is read is checked against the dataclasses and against the rules that types cannot say; every problem is
reported, each with the path of the field.  What is written is read back first, so that the store never writes
what it would refuse.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar, cast

from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config
from pydantic_core import ErrorDetails, PydanticSerializationError

from ecat.errors import FormatError, NotFoundError, SchemaError
from ecat.model import Manifest, ProjectManifest
from ecat.store import files

SESSION_FILE = "session.json"
PROJECT_FILE = "project.json"
MAX_BYTES = 64 << 20
_MAX_PROBLEMS = 100
_INT64 = range(-(2**63), 2**63)
_INT32_COUNT = range(2**31)
_JOURNAL = {"journal_revision", "journal_bytes"}
"""What the record of a layer that nobody has edited does not say."""

M = TypeVar("M", Manifest, ProjectManifest)


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    # the configuration of the outermost dataclass holds for those inside it too
    return TypeAdapter(with_config(ConfigDict(extra="forbid", allow_inf_nan=False))(kind))


def manifest_schema() -> dict[str, Any]:
    """JSON Schema of ``session.json``."""
    return _adapter(Manifest).json_schema()


def project_schema() -> dict[str, Any]:
    """JSON Schema of ``project.json``."""
    return _adapter(ProjectManifest).json_schema()


def table_file(name: str) -> str:
    """Where the table called ``name`` is, inside the session's folder."""
    return f"tables/{name}.parquet"


def layer_file(name: str) -> str:
    """Where the layer called ``name`` is, inside the session's folder."""
    return f"annotations/{name}.xml"


def journal_file(name: str) -> str:
    """Where the journal of the layer called ``name`` is, inside the session's folder."""
    return f"annotations/{name}.journal.jsonl"


def read_manifest_bytes(folder: Path, file: str = SESSION_FILE) -> bytes:
    """The bytes of a manifest.

    Raises
    ------
    NotFoundError : ``folder`` is not there, or holds no such manifest.
    LimitError : it is larger than ``MAX_BYTES``.
    """
    try:
        return files.read_bytes(folder / file, MAX_BYTES)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        raise _not_found(folder, file) from None


def _not_found(folder: Path, file: str) -> NotFoundError:
    kind = "session" if file == SESSION_FILE else "project"
    if not folder.is_dir():
        why, fix = "is not a folder" if folder.exists() else "does not exist", "check the path"
    elif file == SESSION_FILE and (folder / PROJECT_FILE).exists():
        why, fix = "is a project", "name one of the sessions in it"
    else:
        why, fix = f"has no {file}", "check the path, or import the recording first"
    return NotFoundError(f"cannot open {kind} {folder.name or folder}", where=f"{folder}: {why}", fix=fix)


def parse_manifest(data: bytes, path: Path, kind: type[M]) -> M:
    """Read and check a manifest; ``path`` is where it came from.

    Raises
    ------
    FormatError : not JSON, or nested too deeply.
    SchemaError : one problem per wrong field, or written by a newer ecat.
    """
    try:
        manifest: M = _adapter(kind).validate_json(data, strict=True)
    except ValidationError as error:
        details = error.errors(include_url=False)
        raise _refusal(details, path) from None
    if problems := list(_broken_rules(manifest)):
        raise _schema_error(problems, path)
    return manifest


def dump_manifest(manifest: M, path: Path) -> bytes:
    """The manifest as JSON: indented, keys in the order of the fields, the same bytes for the same content.

    Raises
    ------
    SchemaError : it could not be read back.
    FormatError : a name in it, of a file or folder, is not UTF-8.
    """
    kind = type(manifest)
    try:
        left_out = {"layers": dict.fromkeys(_without_journal(manifest), _JOURNAL)}
        data = _adapter(kind).dump_json(manifest, indent=2, warnings=False, exclude=left_out) + b"\n"
    except PydanticSerializationError as error:
        require_utf8(f"cannot write {path.name}", *_texts(asdict(manifest)))
        raise _schema_error([str(error)], path) from None
    parse_manifest(data, path, kind)
    return data


def _without_journal(manifest: Manifest | ProjectManifest) -> Iterator[int]:
    layers = manifest.layers if isinstance(manifest, Manifest) else ()
    return (i for i, layer in enumerate(layers) if not layer.journal_bytes)


def require_utf8(what: str, *names: str) -> None:
    """Return if all ``names`` can be written: a file system may have others, no document can.

    Raises
    ------
    FormatError : one is not UTF-8; the error says that ``what`` could not be done.
    """
    for name in names:
        if not is_utf8(name):
            raise FormatError(
                what,
                where=f"{name}: the name is not UTF-8",
                consequence="nothing was written",
                fix="rename the file or folder, then do it again",
            )


def _texts(data: object) -> Iterator[str]:
    if isinstance(data, str):
        yield data
    elif isinstance(data, Mapping):
        for value in cast("Mapping[str, object]", data).values():
            yield from _texts(value)
    elif isinstance(data, list | tuple):
        for item in cast("Iterable[object]", data):
            yield from _texts(item)


def _refusal(details: list[ErrorDetails], path: Path) -> FormatError | SchemaError:
    first = details[0]
    if first["type"] == "json_invalid":
        return FormatError(
            f"cannot read {path.name}",
            where=f"{path}: {first['msg']}",
            consequence="the session was not opened",
            fix="restore the file from a copy or from version control",
        )
    for detail in details:
        found = detail["input"]
        if detail["loc"] == ("schema_version",) and isinstance(found, int) and found > 1:
            return SchemaError(
                f"cannot read {path.name}",
                problems=(f"schema_version: {found}, this ecat knows versions up to 1",),
                consequence="written by a newer ecat; the session was not opened",
                fix="upgrade ecat",
            )
    return _schema_error([f"{_dotted(d['loc'])}: {d['msg']}" for d in details], path)


def _dotted(location: Iterable[int | str]) -> str:
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return path.removeprefix(".") or "(document)"


def _schema_error(problems: list[str], path: Path) -> SchemaError:
    return SchemaError(
        f"cannot use {path.name}",
        problems=tuple(problems[:_MAX_PROBLEMS]),
        where=f"{path}: "
        + "; ".join(problems[:3])
        + (f"; {len(problems) - 3} more" if len(problems) > 3 else ""),
        consequence="the session was neither opened nor written",
        fix="correct the fields named above, or restore the file",
    )


def _broken_rules(manifest: Manifest | ProjectManifest) -> Iterator[str]:
    if not is_plain_name(manifest.name):
        yield "name: expected a name without path separators and control characters"
    if isinstance(manifest, ProjectManifest):
        return
    for field in ("cameras", "streams", "layers", "tables"):
        names = Counter(item.name for item in getattr(manifest, field))
        yield from (f"{field}: the name {name!r} occurs twice" for name, n in names.items() if n > 1)
    yield from _broken_numbers(manifest)
    for i, stream in enumerate(manifest.streams):
        if (stream.present or stream.file) and not is_inside(stream.file):
            yield f"streams[{i}].file: expected a path inside the session's folder"
    for field, place in (("tables", table_file), ("layers", layer_file)):
        for i, record in enumerate(getattr(manifest, field)):
            if not is_file_name(record.name):
                yield f"{field}[{i}].name: expected letters, digits, '_', '-', '.', '@', '+' and spaces"
            elif record.file != place(record.name):
                yield f"{field}[{i}].file: expected {place(record.name)}"


def _broken_numbers(manifest: Manifest) -> Iterator[str]:
    if manifest.n_frames not in _INT32_COUNT:
        yield "n_frames: expected a count below 2**31"
    counts = {"revision": manifest.revision, "clock.duration_ns": manifest.clock.duration_ns}
    counts |= {f"tables[{i}].rows": table.rows for i, table in enumerate(manifest.tables)}
    for i, layer in enumerate(manifest.layers):
        said = ("revision", "journal_revision", "journal_bytes")
        counts |= {f"layers[{i}].{name}": getattr(layer, name) for name in said}
    for i, stream in enumerate(manifest.streams):
        counts |= {f"streams[{i}].n_frames": stream.n_frames, f"streams[{i}].size_bytes": stream.size_bytes}
    for i, camera in enumerate(manifest.cameras):
        counts |= {f"cameras[{i}].width_px": camera.width_px, f"cameras[{i}].height_px": camera.height_px}
    for path, count in counts.items():
        if count is not None and (count < 0 or count not in _INT64):
            yield f"{path}: expected a count below 2**63"


def is_utf8(name: str) -> bool:
    """Whether ``name``, of a file, can be written in a document; Python keeps other bytes as lone surrogates."""
    return not any("\ud800" <= c <= "\udfff" for c in name)


def is_plain_name(name: str) -> bool:
    """Whether ``name`` can name a folder without leading elsewhere."""
    return name.strip() not in {"", ".", ".."} and not re.search(r"[/\\\x00-\x1f\x7f]", name)


def is_file_name(name: str) -> bool:
    """Whether ``name`` can be the stem of a file anywhere: a letter or digit first, at most 200 bytes."""
    return re.fullmatch(r"[^\W_][\w .@+-]*", name) is not None and len(name.encode()) <= 200


def is_layer_name(name: str) -> bool:
    """Whether ``name`` can be that of a layer: the stem of a file, which would not be taken for a coding scheme's."""
    return is_file_name(name) and not name.lower().endswith(".scheme")


def is_inside(file: str) -> bool:
    """Whether ``file`` is a relative path, with forward slashes, that stays inside its folder."""
    path = PurePosixPath(file)
    plain = bool(path.parts) and all(is_plain_name(part) for part in path.parts) and ":" not in file
    return plain and not path.is_absolute()
