"""What an edit costs, what a kill loses, and what becomes of many who edit at once.

    python benchmarks/annotate.py [--kills 500] [--clients 8] [--steps 500]

Latency is that of steps on a session with 20,000 events, 500 objects and 100,000 frames, until they are on the disk,
beside that of a bare write and fsync in the same folder.  Then as many processes as asked for are killed with SIGKILL
at random instants while they annotate and save; and as many as asked for edit one layer at once.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.annotate import (
    AddEvent,
    AddRelation,
    EditEvent,
    Editor,
    MoveEdge,
    MoveEvent,
    Operation,
    RemoveEvent,
    SetKeyFrame,
    SetRole,
    SplitEvent,
)
from ecat.model import AnnotatedObject, Clock, Event, KeyFrame, Layer, Manifest, Role, Segment
from ecat.store import Draft, Session, create_session, open_session

N_FRAMES, N_OBJECTS, N_EVENTS = 100_000, 500, 20_000


def large_session(path: Path) -> Session:
    """Actions of 40 frames with four sub-events each, and objects with 20 key frames."""
    objects = tuple(
        AnnotatedObject(
            id=f"o{i}", name=f"object {i}", kind="rectangle",
            key_frames=tuple(KeyFrame(frame=f, coordinates=(f, i, 30, 40)) for f in range(0, 2000, 100)),
        )
        for i in range(1, N_OBJECTS + 1)
    )  # fmt: skip
    events: list[Event] = []
    for i in range(N_EVENTS // 5):
        start, parent = i * N_FRAMES // (N_EVENTS // 5), f"a{5 * i + 1}"
        for part in range(5):
            first, last = (start, start + 20) if part == 0 else (start + 5 * (part - 1), start + 5 * part)
            events.append(
                Event(
                    id=f"a{5 * i + part + 1}", type="slide", tier="sub-event" if part else "event",
                    parent=parent if part else None, text="" if part else f"slide object {i % N_OBJECTS + 1}",
                    roles=(Role(name="Theme", target=f"o{i % N_OBJECTS + 1}"),), author="ann",
                    segments=(Segment(start_frame=first, end_frame=last),),
                )
            )  # fmt: skip
    layer = Layer(
        scheme="blocks",
        object_counter=N_OBJECTS,
        event_counter=N_EVENTS,
        objects=objects,
        events=tuple(events),
    )
    clock = Clock(rule="uniform", duration_ns=N_FRAMES * 33_000_000)
    manifest = Manifest(name="large", created="2020-01-01T00:00:00", n_frames=N_FRAMES, clock=clock)
    return create_session(path, Draft(manifest=manifest, layers=(layer,)))


def edits(chance: Random) -> Iterator[Operation]:
    """What a person does."""
    while True:
        i = chance.randrange(N_EVENTS // 5)
        start, name = i * N_FRAMES // (N_EVENTS // 5), f"a{5 * i + 1}"
        yield from (
            MoveEdge(id=f"a{5 * i + 2}", edge="end", frame=start + chance.randint(1, 5)),
            EditEvent(id=name, text=f"slide object {chance.randint(1, 500)} again"),
            AddEvent(type="move", segments=((start, start + 3),), tier="sub-event", parent=name),
            SetRole(id=name, role="Landmark", target=f"o{chance.randint(1, 500)}"),
            SetKeyFrame(
                object=f"o{chance.randint(1, 500)}",
                frame=chance.randrange(N_FRAMES),
                coordinates=(1, 2, 3, 4),
            ),
            AddRelation(
                predicate="ON", arguments=(f"o{1 + i % 500}", "o7"), start_frame=chance.randrange(N_FRAMES)
            ),
            SplitEvent(id=f"a{5 * i + 3}", frame=start + chance.randint(6, 9)),
            MoveEvent(id=name, frames=1),
            RemoveEvent(id=f"a{5 * i + 5}"),
        )


def timed(work: Callable[[], object]) -> float:
    """How long it takes, milliseconds."""
    start = time.perf_counter()
    work()
    return 1000 * (time.perf_counter() - start)


def said(what: str, times: list[float]) -> None:
    """Print the usual figures."""
    cut = statistics.quantiles(times, n=100, method="inclusive")
    figures = f"p50 {cut[49]:7.2f}  p95 {cut[94]:7.2f}  p99 {cut[98]:7.2f}  most {max(times):7.2f} ms"
    print(f"{what:36} {figures}  (n={len(times)})")


def latency(folder: Path, n: int) -> None:
    """Steps on a large session, alone and while it is saved."""
    session = large_session(folder / "large")
    bare = [timed(lambda: bare_append(folder / "bare")) for _ in range(n)]
    opened: list[Editor] = []
    print(f"open the editor {timed(lambda: opened.append(Editor(session, 'main', 'ann'))):.0f} ms")
    editor, source = opened[0], edits(Random(0))
    first = timed(lambda: editor.apply(next(source)))
    print(f"the first step, which begins the journal with the layer {first:.0f} ms")
    alone = [done for done in (one(editor, source) for _ in range(n)) if done]
    undone = [timed(editor.undo) for _ in range(n // 4)]
    said("write and fsync a line", bare)
    said("a step", alone)
    said("undo", undone)
    saving = threading.Thread(target=editor.save)
    start = time.perf_counter()
    saving.start()
    meanwhile: list[float] = []
    while saving.is_alive():
        meanwhile += [done for done in (one(editor, source),) if done]
        time.sleep(0.05)
    print(f"save, beside {len(meanwhile)} steps {time.perf_counter() - start:.2f} s")
    said("a step while it saves", meanwhile)
    print(f"save {timed(editor.save) / 1000:.2f} s; pending {editor.pending}")
    print(f"open the session behind its journal {folded(editor):.2f} s")


def one(editor: Editor, source: Iterator[Operation]) -> float:
    """The time of one step, or 0 if it was refused."""
    from ecat.errors import OperationError

    operation = next(source)
    try:
        return timed(lambda: editor.apply(operation))
    except OperationError:
        return 0.0


def folded(editor: Editor) -> float:
    """Seconds to open the session when a step is in the journal only."""
    editor.apply(EditEvent(id="a1", text="the last"))
    seconds = timed(lambda: open_session(editor.session.path)) / 1000
    assert open_session(editor.session.path).layer().events[0].text == "the last"
    return seconds


def bare_append(path: Path) -> None:
    """What no journal can be faster than."""
    with path.open("ab") as file:
        file.write(b"x" * 500)
        file.flush()
        os.fsync(file.fileno())


def annotators(*words: object) -> Any:
    """What :mod:`tests.annotate.annotators` found."""
    command = [sys.executable, "-m", "tests.annotate.annotators", *map(str, words)]
    root = Path(__file__).parents[1]
    return json.loads(subprocess.run(command, cwd=root, stdout=subprocess.PIPE, check=True).stdout)


def empty_session(path: Path) -> Path:
    """A session of a thousand frames without annotations."""
    manifest = Manifest(name="small", created="2020-01-01T00:00:00", n_frames=1000)
    return create_session(path, Draft(manifest=manifest)).path


def durability(folder: Path, n: int) -> None:
    """Kill annotators."""
    start = time.perf_counter()
    found = annotators("kills", n, empty_session(folder / "kills"))
    failures = [one for one in found if "failure" in one]
    whole = [one for one in found if "failure" not in one]
    lost = sum(one["acknowledged"] > one["found"] for one in whole)
    wrong = sum(not one["same"] or bool(one["faults"]) for one in whole)
    steps = max(one["found"] for one in whole)
    print(
        f"{n} kills, {steps} steps: {lost} lost what was acknowledged, {wrong} left a fault, "
        f"{len(failures)} did not open ({time.perf_counter() - start:.0f} s)"
    )
    for failure in failures[:3]:
        print(failure)


def concurrency(folder: Path, clients: int, steps: int) -> None:
    """Many at once."""
    start = time.perf_counter()
    found = annotators("many", clients, steps, empty_session(folder / "many"))
    print(
        f"{clients} editors x {steps} steps: {found['steps']} in the journal, by author {found['by_author']}, "
        f"the saved layer is the journal's: {found['same']}, faults {found['faults']} "
        f"({time.perf_counter() - start:.0f} s)"
    )


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--edits", type=int, default=400)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--steps", type=int, default=500)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        latency(Path(folder), asked.edits)
        if asked.kills:
            durability(Path(folder), asked.kills)
        if asked.clients:
            concurrency(Path(folder), asked.clients, asked.steps)


if __name__ == "__main__":
    main()
