"""``params.param``: which workspaces ECAT knows (§1.1)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ecat.errors import FormatError
from ecat.formats.ecat2018.lexical import text
from ecat.formats.ecat2018.xml_input import parse_safe, reading

MAX_BYTES = 16 << 20


@dataclass(frozen=True, slots=True)
class ProgramParams:
    """Windows paths of the workspace opened at start, if one is, and of those opened before."""

    default_workspace: str | None = None
    recent_workspaces: tuple[str, ...] = ()


def read_program_params(source: Path | bytes) -> ProgramParams:
    """Read the settings.

    Raises
    ------
    FormatError : not this kind of XML.
    LimitError : above 16 MiB.
    """
    what = reading(source, "params.param")
    root = parse_safe(source, what=what, max_bytes=MAX_BYTES)
    if root.tag != "ws":
        raise FormatError(what, where=f"line {root.sourceline}: the root is <{root.tag}>, expected <ws>")
    recent = tuple(element.text or "" for element in root.iterfind("recentWorkspaces/workspace"))
    return ProgramParams(root.findtext("defaultWorkspace"), recent)


def write_program_params(params: ProgramParams) -> bytes:
    """The file: UTF-8 with BOM, indented, CRLF; ``<recentWorkspaces>`` is always written."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<ws>"]
    if params.default_workspace is not None:
        lines.append(f"  <defaultWorkspace>{text(params.default_workspace)}</defaultWorkspace>")
    if params.recent_workspaces:
        rows = [f"    <workspace>{text(path)}</workspace>" for path in params.recent_workspaces]
        lines += ["  <recentWorkspaces>", *rows, "  </recentWorkspaces>"]
    else:
        lines.append("  <recentWorkspaces />")
    return "\r\n".join([*lines, "</ws>"]).encode("utf-8-sig")
