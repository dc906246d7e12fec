"""A recogniser of actions on recordings of another camera, other boxes and another table than it learned from.

    python benchmarks/recognize_recordings.py RUN [--shared ../shared]

RUN is the folder of a trained recogniser.  The three real Kinect sessions are imported and processed, what is
recognised is proposed (``ecat learn recognize predict``), and compared with the slides that people annotated: how many
have a proposal that overlaps with them by half of what both cover (IoU) or at all, and of the one that overlaps most,
whether the right box is the one that moves, and whether the preposition is right ("next to" is none that is learned;
for it, "to" counts).  They have no skeleton.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.cli import main as ecat
from ecat.formats import import_source
from ecat.model.annotation import MACHINE
from ecat.process import calibrate, process_session
from ecat.store import Session, find_sessions, open_session
from learn.recognize.proposals import AUTHOR

PREPOSITIONS = {"SlidePast": "past", "SlideAway": "from", "SlideNext": "to"}
"""What was shown again and again, and how types of proposals end that say so."""


@dataclass(frozen=True)
class Slide:
    """What somebody did, or is proposed to have done: which box, when, and what it is called."""

    mover: str
    start: int
    end: int
    type: str

    def iou(self, other: Slide) -> float:
        """Of both spans, the share that they have in common."""
        both = min(self.end, other.end) - max(self.start, other.start)
        return max(0, both) / (max(self.end, other.end) - min(self.start, other.start))


def annotated(session: Session) -> list[Slide]:
    """What people said: "Slide Shell past Stella Artois"."""
    objects = {row["name"]: row["object_id"] for row in session.objects.to_arrow().to_pylist()}
    return [
        Slide(
            next(id_ for name, id_ in objects.items() if e["text"].startswith(f"Slide {name}")),
            e["start_frame"],
            e["end_frame"],
            e["type"],
        )
        for e in session.events.to_arrow().to_pylist()
        if e["layer"] != MACHINE
    ]


def proposed(session: Session) -> list[Slide]:
    """What the recogniser said of each movement; what moves is the object of what a performer does, or the subject."""
    roles: dict[str, dict[str, str]] = {}
    for row in session.event_roles.to_arrow().to_pylist():
        if row["layer"] == MACHINE:
            roles.setdefault(row["event_id"], {})[row["role"]] = row["target"]
    return [
        Slide(said.get("Object") or said["Subject"], e["start_frame"], e["end_frame"], e["type"])
        for e in session.events.to_arrow().to_pylist()
        if e["author"] == AUTHOR and e["parent"] is None and (said := roles[e["event_id"]])
    ]


def compared(true: Sequence[Slide], said: Sequence[Slide], preposition: str) -> tuple[int, ...]:
    """Numbers of annotated slides: all, overlapped by half, overlapped, with the right box, with the preposition."""
    best = [max(said, key=one.iou, default=None) for one in true]
    pairs = [(one, other) for one, other in zip(true, best, strict=True) if other and one.iou(other) > 0]
    return (
        len(true),
        sum(one.iou(other) >= 0.5 for one, other in pairs),
        len(pairs),
        sum(one.mover == other.mover for one, other in pairs),
        sum(other.type.endswith(f"_{preposition}") for _, other in pairs),
    )


def main() -> None:
    """Import, process, recognise, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--shared", type=Path, default=Path(__file__).resolve().parents[2] / "shared")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        project = Path(scratch, "project")
        import_source(given.shared / "data" / "ecat_kinect", project)
        paths = find_sessions(project)
        boxes = calibrate(paths)
        for path in paths:
            process_session(path, prototypes=boxes)
        arguments = ["learn", "recognize", "predict", str(project), "--run", str(given.run.resolve()), "-q"]
        if code := ecat(arguments):
            sys.exit(code)
        print("| session | slides | proposed, IoU >= 0.5 | proposed | right box | preposition | proposals |")
        print("|---|---|---|---|---|---|---|")
        total: list[Any] = [0] * 6
        for path in paths:
            session = open_session(path)
            said, kind = proposed(session), path.parent.name
            row = (*compared(annotated(session), said, PREPOSITIONS[kind]), len(said))
            total = [a + b for a, b in zip(total, row, strict=True)]
            print(f"| {kind} | {' | '.join(map(str, row))} |")
        print(f"| together | {' | '.join(map(str, total))} |")


if __name__ == "__main__":
    main()
