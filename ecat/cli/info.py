"""``ecat info``: what is in a session, project or workspace, or in a file that lies beside recordings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.text import columns, count, duration, listing
from ecat.cli.transfer import Place
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.cli.describe import Data

MOST_SESSIONS = 20
"""Sessions listed for a person; --json lists all."""
UNITS = ("px", "mm", "s")
"""Units that names of numbers end with, as in all of ecat."""
COUNTED = ("frames", "objects", "events", "relations")


@verb("info", examples=("ecat info my_session", "ecat info my_project --json", "ecat info option.txt"))
@click.argument("path", type=Place(), help="A session, project or workspace (also at a URL), or a file.")
def command(out: Output, path: Path | str) -> None:
    """Say what is in a session, project or workspace, or in a file.

    Name, frames, duration, clock, cameras, streams, annotation layers, tables with the stage that made each,
    and where it all comes from.

    Of files it knows those that lie beside the recordings of ECAT 2018: option.txt, params.param, *.project,
    coordinateMapping.dat, *.glyph, VoxML, bodyScheme.xml, rig_*.xml, *.dep, and the event exports.
    """
    from ecat.cli.describe import describe
    from ecat.store import remote

    with remote.all_at_hand(path) as place:
        found = describe(place)
    as_text = {"session": session_text, "file": file_text}.get(found["kind"], project_text)
    out.result(found, as_text(found))


def session_text(found: Data) -> str:
    """A session as aligned text."""
    start = found["clock"]["start"]
    head = [
        ["frames", _amount(found, "frames")],
        ["duration", _duration(found)],
        ["clock", found["clock"]["rule"] + (f", from {start}" if start else "")],
        ["boxes", ", ".join(found["prototypes"]) or "not calibrated"],
        ["source", _provenance(found)],
    ]
    return "\n\n".join(
        [
            f"session {found['name']}\n{columns(head, indent=2)}",
            _block("cameras", [_camera_row(camera) for camera in found["cameras"]]),
            _block("streams", [_stream_row(stream) for stream in found["streams"]]),
            *(_layer_text(layer) for layer in found["layers"]),
            _block("tables", [_table_row(table) for table in found["tables"]]),
            _block("notes", [[note] for note in found["notes"]]),
        ]
    )


def project_text(found: Data) -> str:
    """A project, a workspace or any folder of sessions as aligned text."""
    totals = found["totals"]
    head = [[name, _amount(totals, name)] for name in ("sessions", *COUNTED)]
    head += [["duration", _duration(totals)], ["source", _provenance(found)]]
    listed = found["sessions"][:MOST_SESSIONS]
    left = len(found["sessions"]) - len(listed)
    more = f"\n  and {left:,} more; --json lists all" if left else ""
    return "\n\n".join(
        [
            f"{found['kind']} {found['name']}\n{columns(head, indent=2)}",
            _block("sessions", [_session_row(session) for session in listed]) + more,
            _block("notes", [[note] for note in found["notes"]]),
        ]
    )


def file_text(found: Data) -> str:
    """A file beside recordings as aligned text: what is single first, then every list that is not empty."""
    single = [["what", found["what"]], ["", found["description"]]]
    blocks: list[str] = []
    for name, value in found["holds"].items():
        if isinstance(value, Mapping):
            blocks.append(_block(_words(name), [[key, _cell(text)] for key, text in value.items()]))
        elif isinstance(value, list) and value:
            blocks.append(_block(_words(name), [_file_row(row) for row in value]))
        elif not isinstance(value, list):
            words, unit = _split_unit(name)
            single.append([words, f"{_cell(value)} {unit}".strip()])
    return "\n\n".join([f"file {found['name']}\n{columns(single, indent=2)}", *blocks])


def _file_row(row: Any) -> list[str]:
    """One of a list: a text, or several values, numbers followed by what they count."""
    if not isinstance(row, Mapping):
        return [_cell(row)]
    cells: list[str] = []
    for name, value in row.items():
        is_number = isinstance(value, int | float)
        cells += [_cell(value), _split_unit(name)[1] or _words(name)] if is_number else [_cell(value)]
    return cells


def _split_unit(name: str) -> tuple[str, str]:
    """``near_mm`` is near, in mm."""
    head, _, unit = name.rpartition("_")
    return (_words(head), unit) if head and unit in UNITS else (_words(name), "")


def _words(name: str) -> str:
    return name.replace("_", " ")


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return "unknown" if value is None else str(value) or "(empty)"


def _block(title: str, rows: list[list[str]]) -> str:
    return f"{title}\n{columns(rows or [['none']], indent=2)}"


def _amount(found: Data, name: str) -> str:
    """How many; a recording that says nothing of its length has 0 frames in its manifest."""
    return "unknown" if name == "frames" and not found[name] else f"{found[name]:,}"


def _duration(found: Data) -> str:
    return "unknown" if found["duration_s"] is None else duration(found["duration_s"])


def _provenance(found: Data) -> str:
    source = found["provenance"]
    by = f"{source['format']} by {source['software']}" if source["software"] else source["format"]
    return f"{source['source']} ({by})" if by else source["source"] or "unknown"


def _camera_row(camera: Data) -> list[str]:
    focal = f"f {camera['fx_px']:.1f}, {camera['fy_px']:.1f} px"
    centre = f"c {camera['cx_px']:.1f}, {camera['cy_px']:.1f} px"
    size = f"{camera['width_px']} x {camera['height_px']} px"
    return [camera["name"], size, focal, centre, "mirrored" if camera["mirrored"] else "", camera["source"]]


def _stream_row(stream: Data) -> list[str]:
    frames = "" if stream["frames"] is None else count(stream["frames"], "frame")
    return [
        stream["name"],
        stream["kind"],
        "there" if stream["present"] else "missing",
        stream["codec"],
        frames,
    ]


def _layer_text(layer: Data) -> str:
    scheme = f", coding scheme {layer['scheme']}" if layer["scheme"] else ""
    rows = [
        [name, f"{sum(parts.values()) if total is None else total:,}", listing(parts)]
        for name, total, parts in (
            ("objects", None, layer["objects"]),
            ("events", layer["events"], layer["event_types"]),
            ("relations", layer["relations"], layer["predicates"]),
        )
    ]
    return f"layer {layer['name']}, revision {layer['revision']}{scheme}\n{columns(rows, indent=2)}"


def _table_row(table: Data) -> list[str]:
    return [table["name"], f"{table['rows']:,}", "rows", table["stage"] or "import"]


def _session_row(session: Data) -> list[str]:
    if "error" in session:
        return [session["path"], session["error"]]
    counts = [cell for name in COUNTED for cell in (_amount(session, name), name)]
    return [session["path"], *counts, ", ".join(session["stages"])]
