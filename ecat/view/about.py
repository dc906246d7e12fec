"""The session at a glance, as a document."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from ecat.geometry.transforms import Floats
from ecat.model import Manifest
from ecat.view.lanes import event_name, is_proposed
from ecat.view.scene import Scene, by_object, finite, numbers, texts

_MOST_EVENTS = 12


def about(manifest: Manifest, tables: Mapping[str, pa.Table], scene: Scene) -> str:
    """Markdown: what was recorded, who takes part, what happens, how well the boxes are known."""
    parts = [f"# {manifest.name}", _recording(manifest, scene), _objects(tables, scene), _events(tables)]
    parts += [_poses(tables, scene), _notes(manifest)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _recording(manifest: Manifest, scene: Scene) -> str:
    t_ns = scene.timebase.t_ns
    length = f", {(t_ns[-1] - t_ns[0]) * 1e-9:.1f} s" if t_ns is not None else ", no clock"
    n = manifest.n_frames
    lines = [f"{n or 'unknown number of'} {'frame' if n == 1 else 'frames'}{length}"]
    if manifest.clock.start:
        lines.append(f"recorded {manifest.clock.start}")
    streams = [f"{s.name} ({s.kind}{'' if s.present else ', file missing'})" for s in manifest.streams]
    if streams:
        lines.append("streams: " + ", ".join(streams))
    return "\n".join(f"- {line}" for line in lines)


def _objects(tables: Mapping[str, pa.Table], scene: Scene) -> str:
    if "objects" not in tables or not tables["objects"].num_rows:
        return ""
    rows = tables["objects"].to_pylist()
    names = dict.fromkeys((scene.thing(row["object_id"]).name, row["kind"].replace("_", " ")) for row in rows)
    return "## Objects\n\n" + "\n".join(f"- {_escape(name)}: {kind}" for name, kind in names)


def _events(tables: Mapping[str, pa.Table]) -> str:
    if "events" not in tables or not tables["events"].num_rows:
        return ""
    rows = tables["events"].to_pylist()
    said, proposed = (
        Counter(event_name(row) for row in rows if is_proposed(row) == state) for state in (False, True)
    )
    names = sorted(said | proposed, key=lambda name: (-said[name], -proposed[name], name))
    lines = [f"| {_escape(name)} | {said[name]} | {proposed[name]} |" for name in names[:_MOST_EVENTS]]
    if rest := names[_MOST_EVENTS:]:
        more, offered = (sum(counts[name] for name in rest) for counts in (said, proposed))
        lines.append(f"| {len(rest)} others | {more} | {offered} |")
    return "## Events\n\n| event | times | proposed |\n|---|---:|---:|\n" + "\n".join(lines)


def _poses(tables: Mapping[str, pa.Table], scene: Scene) -> str:
    if "poses" not in tables or not tables["poses"].num_rows:
        return "" if "markers_2d" not in tables else "No poses yet: `ecat process` computes them."
    lines: list[str] = []
    for object_id, rows in by_object(tables["poses"]):
        known = finite(numbers(rows, "x y z")) & (texts(rows, "source") == "observed")
        residual, sigma = numbers(rows, "residual_px sigma_m")[known].T
        share = known.sum() / max(scene.timebase.n_frames, 1)
        name, sigma_mm = _escape(scene.thing(object_id).name), _median(sigma) * 1000
        lines.append(f"| {name} | {share:.0%} | {_median(residual):.2f} | {sigma_mm:.1f} |")
    head = "## Poses\n\n| box | frames seen | residual, px | sigma, mm |\n|---|---:|---:|---:|\n"
    return head + "\n".join(lines)


def _median(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")


def _notes(manifest: Manifest) -> str:
    source = " ".join(filter(None, [manifest.provenance.format, manifest.provenance.source]))
    lines = ([f"imported from {_escape(source)}"] if source else []) + [
        _escape(n) for n in manifest.provenance.notes
    ]
    return "## Provenance\n\n" + "\n".join(f"- {line}" for line in lines) if lines else ""


def _escape(text: str) -> str:
    return "".join(f"\\{c}" if c in "\\`*_|[]<>#" else c for c in " ".join(text.split()))
