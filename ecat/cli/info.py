"""``ecat info``: what is in a session, project or workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ecat.cli.output import Output
from ecat.cli.text import columns, count, duration, listing
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.cli.describe import Data

MOST_SESSIONS = 20
"""Sessions listed for a person; --json lists all."""
COUNTED = ("frames", "objects", "events", "relations")


@verb("info", examples=("ecat info my_session", "ecat info my_project --json"))
@click.argument("path", type=click.Path(path_type=Path), help="A session, project or workspace.")
def command(out: Output, path: Path) -> None:
    """Say what is in a session, project or workspace.

    Name, frames, duration, clock, cameras, streams, annotation layers, tables with the stage that made each,
    and where it all comes from.
    """
    from ecat.cli.describe import describe

    found = describe(path)
    out.result(found, session_text(found) if found["kind"] == "session" else project_text(found))


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
