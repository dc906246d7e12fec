"""Sessions whose truth is known: generated ones with poses and the table as they really were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from ecat.formats.format import Format
from ecat.formats.options import read_options
from ecat.model import Manifest
from ecat.progress import silent
from ecat.sample import NOISELESS, GroundTruth, ground_truth_tables, sample_session
from ecat.sample.recording import sample_recording
from ecat.store import Draft, Session, TableData, create_session
from ecat.tables import TABLES

HIDDEN = range(20, 30)
"""Frames at which the first block is nowhere, and those after at which it was filled in."""
FILLED = range(30, 34)
SIZE, DEPTH_SIZE = (192, 108), (128, 106)


def table(of: str, /, **columns: Sequence[object]) -> pa.Table:
    """The session's table ``of`` that name; what is not given is null."""
    n = len(next(iter(columns.values())))
    schema = TABLES[of].arrow
    given = [pa.array(list(columns.get(field.name, [None] * n)), type=field.type) for field in schema]
    return pa.Table.from_arrays(given, schema=schema)


def exported(chosen: Format, session: Session, out: Path, **options: str) -> tuple[str, ...]:
    """Write a session as somebody would who types options; the findings."""
    assert chosen.part is not None
    return chosen.part(session, "it", out, read_options(chosen.options, options, chosen.name), silent)


def made(
    folder: Path, *, seed: int = 5, actions: tuple[str, ...] = ("next",), pixels: bool
) -> tuple[Session, GroundTruth]:
    """A session with everything that these formats write; ``pixels``: with video, depth and sound."""
    plain, truth = sample_session(seed=seed, actions=actions, noise=NOISELESS)
    draft = plain
    if pixels:
        recording = sample_recording(
            seed=seed, actions=actions, size=SIZE, depth_size=DEPTH_SIZE, depth_every=3
        )
        draft, truth = recording.draft, recording.truth
    manifest = replace(draft.manifest, prototypes=tuple(box.to_dict() for box in truth.prototypes))
    tables = {"markers_2d": plain.tables["markers_2d"], **draft.tables, **true_tables(truth)}
    session = create_session(folder, replace(draft, manifest=manifest, tables=tables))
    return session, truth


def true_tables(truth: GroundTruth) -> dict[str, TableData]:
    """Where the blocks and the table were; the first block is unknown at some frames and interpolated at others."""
    rows = ground_truth_tables(truth)["poses"]
    frame = np.asarray(rows["frame"])
    first = np.asarray(rows["object_id"].to_pylist()) == truth.object_ids[0]
    gone, filled = first & np.isin(frame, HIDDEN), first & np.isin(frame, FILLED)
    columns = {name: rows[name].to_pylist() for name in ("t_ns", "frame", "object_id")}
    for name in ("x", "y", "z", "qx", "qy", "qz", "qw", "support"):
        values = rows[name].to_pylist()
        columns[name] = [None if lost else value for value, lost in zip(values, gone, strict=True)]
    columns["source"] = [
        None if lost else "interpolated" if made_up else "observed"
        for lost, made_up in zip(gone, filled, strict=True)
    ]
    plane: pa.Table = ground_truth_tables(truth)["table_plane"]
    fit = {name: plane[name].to_pylist() for name in plane.column_names}
    return {
        "poses": TableData(data=table("poses", **columns)),
        "table_plane": TableData(
            data=table("table_plane", frame=[0], n_points=[9], n_inliers=[9], evidence=["polygon"], **fit)
        ),
    }


def bare(folder: Path) -> Session:
    """A session of which nothing is known but that it was made."""
    return create_session(folder, Draft(manifest=Manifest(name="bare", created="2024-01-01T00:00:00")))
