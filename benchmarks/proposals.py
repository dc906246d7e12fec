"""Event proposals against what happened: generated sessions, and the real ones against their human spans.

    python benchmarks/proposals.py [--shared ../shared] [--sessions 8]

A proposed action counts if it is of the same object and its span overlaps with a true one by half of what both cover
(IoU >= 0.5); each is matched with at most one, as many as possible.  Printed for generated sessions: F1 of actions from
the first touch to the last (of single movements where there are no hands), rearrangements included, and how far the
parts are off, for poses that are the truth with noise, outliers and gaps, and for the whole pipeline from markers.
Then, for sessions that show one kind of action again and again, generated and real, where annotators leave out how the
boxes are put back: all actions, those that are not called ``set``, and, of the real ones, those of the kind that the
session was recorded for, which proposals do not know.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from scipy.optimize import linear_sum_assignment

from ecat.formats import import_source
from ecat.model.annotation import MACHINE
from ecat.process import calibrate, process_session
from ecat.sample import ACTIONS, sample_session
from ecat.sample.truth import GroundTruth
from ecat.sample.truth_tables import ground_truth_tables
from ecat.stages.propose import ProposeParameters, propose_events
from ecat.store import Draft, Session, create_session, find_sessions, open_session
from ecat.tables import POSES

FIRST_SEED = 9000
"""Parameters were chosen on smaller seeds."""
Span: TypeAlias = tuple[str, int, int]
Counts: TypeAlias = tuple[int, int, int]


def matches(proposed: Sequence[Span], true: Sequence[Span]) -> list[tuple[int, int]]:
    """Pairs of positions, one to one, with IoU of at least 0.5."""
    if not proposed or not true:
        return []
    iou = np.zeros((len(proposed), len(true)))
    for i, (name, start, end) in enumerate(proposed):
        for j, (other, first, last) in enumerate(true):
            if name == other:
                iou[i, j] = max(0, min(end, last) - max(start, first)) / (max(end, last) - min(start, first))
    good = np.where(iou >= 0.5, iou, 0.0)
    rows, columns = linear_sum_assignment(-(good + (good > 0)))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if good[i, j] > 0]


def f1(counts: Counts) -> float:
    """From numbers of pairs, proposals, and true spans."""
    return 2 * counts[0] / max(counts[1] + counts[2], 1)


def counted(proposed: Sequence[Span], true: Sequence[Span]) -> Counts:
    """Pairs, proposals, true spans."""
    return len(matches(proposed, true)), len(proposed), len(true)


def total(counts: Sequence[Counts]) -> Counts:
    """Sums."""
    a, b, c = (sum(column) for column in zip(*counts, strict=True))
    return a, b, c


def spans(events: Sequence[dict[str, Any]], part: str | None = None) -> list[Span]:
    """Actions, or parts of one type, of a table of proposals."""
    kept = [e for e in events if (e["parent"] is None if part is None else e["type"] == part)]
    return [(e["object_id"], e["start_frame"], e["end_frame"]) for e in kept]


def true_spans(truth: GroundTruth, part: str | None = None) -> list[Span]:
    """What happened, as :func:`spans`."""
    found: list[Span] = []
    for move in truth.moves:
        name = truth.object_ids[move.box]
        if part is None:
            found.append((name, move.carries[0].grasp, move.carries[-1].retreat))
            continue
        for c in move.carries:
            parts = {
                "grasp": (c.grasp, c.hold),
                "hold": (c.hold, c.release),
                "move": (c.move, c.still),
                "release": (c.release, c.retreat),
            }
            found.append((name, *parts[part]))
    return found


def wanted(truth: GroundTruth) -> list[Span]:
    """The actions that an annotator would mark."""
    return [t for t, move in zip(true_spans(truth), truth.moves, strict=True) if move.kind != "set"]


def not_set(events: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Proposals without those that only set up the next one."""
    return [event for event in events if not event["type"].startswith("set")]


def movements(truth: GroundTruth) -> list[Span]:
    """Every stretch in which a box is on its way: without hands, a second grasp cannot be told from a second action."""
    return true_spans(truth, "move")


def noisy_poses(truth: GroundTruth, rng: np.random.Generator) -> pa.Table:
    """True poses with 2 mm and 0.7 degrees of noise, 1 % outliers of 4 cm, and 3 outages a minute of up to 0.7 s."""
    table = ground_truth_tables(truth)["poses"]
    n, boxes = truth.n_frames, len(truth.object_ids)
    lost = np.zeros((n, boxes), bool)
    for box in range(boxes):
        for start in rng.integers(0, n, max(1, round(n / 600))):
            lost[start : start + int(rng.integers(3, 21)), box] = True
    keep = ~lost.ravel()
    columns: dict[str, Any] = {}
    outlier = rng.random(n * boxes) < 0.01
    for axis in "xyz":
        noise = rng.normal(0, 0.002, n * boxes) + outlier * rng.normal(0, 0.04, n * boxes)
        columns[axis] = pa.array(table[axis].to_numpy() + noise, mask=~keep)
    turn = np.stack([table[q].to_numpy() for q in ("qx", "qy", "qz", "qw")], -1)
    turn = turn + rng.normal(0, 0.006, turn.shape)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    for q, column in zip(("qx", "qy", "qz", "qw"), turn.T, strict=True):
        columns[q] = pa.array(column, mask=~keep)
    words = np.where(keep, "observed", "")
    columns |= {name: table[name] for name in ("t_ns", "frame", "object_id", "support")}
    columns["source"] = pa.array(words, pa.string(), mask=~keep)
    columns["sigma_m"] = pa.array(np.full(n * boxes, 0.002), mask=~keep)
    columns["sigma_rad"] = pa.array(np.full(n * boxes, 0.012), mask=~keep)
    rest = {field.name: pa.nulls(n * boxes, field.type) for field in POSES.arrow if field.name not in columns}
    return pa.table({name: (columns | rest)[name] for name in POSES.arrow.names}).cast(POSES.arrow)


def _rows(draft: Draft, name: str) -> pa.Table:
    data = draft.tables[name].data
    assert isinstance(data, pa.Table)
    return data


def from_truth(draft: Draft, truth: GroundTruth, *, hands: bool = True) -> list[dict[str, Any]]:
    """Proposals from noisy poses."""
    columns: dict[str, Any] = {"frame": pa.array(range(truth.n_frames), pa.int32()), "t_ns": truth.t_ns}
    clock = pa.table(columns)
    poses = noisy_poses(truth, np.random.default_rng(truth.seed))
    plane = ground_truth_tables(truth)["table_plane"].to_pydict() | {"frame": [0]}
    events = propose_events(
        clock,
        poses,
        pa.table(plane),
        joints=_rows(draft, "joints") if hands else None,
        markers_2d=_rows(draft, "markers_2d"),
        parameters=ProposeParameters(prototypes=truth.prototypes, camera=truth.scene.color),
    )
    return events.to_pylist()


def from_session(session: Session) -> list[dict[str, Any]]:
    """Proposals from what ``ecat process`` made of a session."""
    from ecat.process.inputs import clock_table, session_camera
    from ecat.process.prototypes import kept_prototypes

    def table(name: str) -> pa.Table | None:
        return session.table(name).to_arrow() if session.has_table(name) else None

    poses, plane = table("poses"), table("table_plane")
    assert poses is not None
    assert plane is not None
    events = propose_events(
        clock_table(session),
        poses,
        plane,
        joints=table("joints"),
        markers_2d=table("markers_2d"),
        markers_3d=table("markers_3d"),
        parameters=ProposeParameters(prototypes=kept_prototypes(session), camera=session_camera(session)),
    )
    return events.to_pylist()


def _line(*cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def generated(n_sessions: int, folder: Path) -> None:
    """Figures on generated sessions."""
    ways = ("true poses, noise", "the same, no hands", "markers to proposals")
    found: dict[str, list[Counts]] = {name: [] for name in ways}
    annotated: list[Counts] = []
    off: dict[str, list[int]] = {}
    for seed in range(FIRST_SEED, FIRST_SEED + n_sessions):
        draft, truth = sample_session(seed=seed)
        create_session(folder / f"s{seed}", draft)
        process_session(folder / f"s{seed}")
        made = dict(
            zip(
                ways,
                (
                    from_truth(draft, truth),
                    from_truth(draft, truth, hands=False),
                    from_session(open_session(folder / f"s{seed}")),
                ),
                strict=True,
            )
        )
        for name, events in made.items():
            true = movements(truth) if name == ways[1] else true_spans(truth)
            found[name].append(counted(spans(events), true))
        events = made[ways[2]]
        annotated.append(counted(spans(not_set(events)), wanted(truth)))
        for part in ("grasp", "hold", "move", "release"):
            mine, true = spans(events, part), true_spans(truth, part)
            for i, j in matches(mine, true):
                off.setdefault(part, []).extend((abs(mine[i][1] - true[j][1]), abs(mine[i][2] - true[j][2])))
            found.setdefault(f"  part: {part}", []).append(counted(mine, true))
    print("| generated sessions | matched | proposed | true | F1 (target 0.95) |\n|---|---|---|---|---|")
    for name, counts in found.items():
        print(_line(name, *total(counts), f"{f1(total(counts)):.3f}"))
    counts = total(annotated)
    print(_line("markers, not `set`, against the annotated ones only", *counts, f"{f1(counts):.3f}"))
    for part, frames in off.items():
        print(f"{part}: median {np.median(frames):.0f}, 90 % {np.quantile(frames, 0.9):.0f} frames off")


def series() -> None:
    """Figures on generated sessions of one kind, each ten times."""
    print("\n| generated series of | of | matched | proposed | annotated | F1 |\n|---|---|---|---|---|---|")
    for number, kind in enumerate(ACTIONS):
        draft, truth = sample_session(seed=FIRST_SEED + 100 + number, actions=(kind,) * 10)
        events = from_truth(draft, truth)
        for which, kept in (("all", events), ("not `set`", not_set(events))):
            counts = counted(spans(kept), wanted(truth))
            print(_line(kind, which, *counts, f"{f1(counts):.3f}"))


def real(shared: Path, folder: Path) -> None:
    """Figures on the real sessions."""
    import_source(shared / "data" / "ecat_kinect", folder / "real")
    print(
        "\n| real session | of | matched | proposed | human | F1 (target 0.85) |\n|---|---|---|---|---|---|"
    )
    rows: dict[str, list[Counts]] = {"all": [], "not `set`": [], "its kind": []}
    paths = find_sessions(folder / "real")
    boxes = calibrate(paths)
    for path in paths:
        process_session(path, prototypes=boxes)
        session = open_session(path)
        names = {row["name"]: row["object_id"] for row in session.objects.to_arrow().to_pylist()}
        human = [
            (
                names[next(n for n in names if e["text"].startswith(f"Slide {n}"))],
                e["start_frame"],
                e["end_frame"],
            )
            for e in session.events.to_arrow().to_pylist()
            if e["layer"] != MACHINE
        ]
        events = [e for e in from_session(session) if e["parent"] is None]
        kind = path.parent.name.removeprefix("Slide").lower()
        chosen = (events, not_set(events), [e for e in events if e["type"].endswith(kind)])
        for (which, counts), kept in zip(rows.items(), chosen, strict=True):
            counts.append(counted(spans(kept), human))
            print(_line(path.parent.name, which, *counts[-1], f"{f1(counts[-1]):.3f}"))
    for which, counts in rows.items():
        print(_line("together", which, *total(counts), f"{f1(total(counts)):.3f}"))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shared", type=Path, default=Path(__file__).resolve().parents[2] / "shared")
    parser.add_argument("--sessions", type=int, default=8)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        generated(arguments.sessions, Path(name))
        series()
        if (arguments.shared / "data" / "ecat_kinect").is_dir():
            real(arguments.shared, Path(name))
        else:
            print(f"real sessions skipped: the reference data is not at {arguments.shared}")


if __name__ == "__main__":
    main()
