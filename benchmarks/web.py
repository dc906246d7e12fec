"""How long the annotation page's server takes, over HTTP, with a long and crowded session.

``python benchmarks/web.py`` serves a session of 100,000 frames with 20,000 events and 500 objects in a process of its
own, as ``ecat annotate`` does, and prints what a page waits for; then eight clients edit it at once, and the layer is
compared with the journal's operations done again one after the other.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pyarrow as pa

sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.annotate import Editor, operations_from_list
from ecat.errors import EcatError
from ecat.model import AnnotatedObject, Clock, Event, KeyFrame, Layer, Manifest, Role, Segment, Stream
from ecat.store import Draft, Journal, TableData, create_session, open_session
from ecat.tables import TABLES

N_FRAMES, N_EVENTS, N_OBJECTS = 100_000, 20_000, 500
KEY_FRAMES = 20
EDITS = 400
CLIENTS, EACH = 8, 500
STEP_NS = 33_333_333
MAIN = "/api/sessions/long/layers/main"


def crowded_layer() -> Layer:
    """Actions of four parts each, one after the other, of objects that were drawn now and then."""
    objects = tuple(
        AnnotatedObject(
            id=f"o{i}",
            name=f"object {i}",
            kind="rectangle",
            stream="color",
            key_frames=tuple(
                KeyFrame(frame=k * N_FRAMES // KEY_FRAMES + i, coordinates=(i % 900 + k, i % 500, 40.0, 30.5))
                for k in range(KEY_FRAMES)
            ),
        )
        for i in range(1, N_OBJECTS + 1)
    )
    length, events = N_FRAMES // (N_EVENTS // 5), list[Event]()
    for i in range(N_EVENTS // 5):
        start, roles = i * length, (Role(name="Theme", target=f"o{i % N_OBJECTS + 1}"),)
        whole = Segment(start_frame=start, end_frame=start + length)
        parent = f"a{len(events) + 1}"
        events.append(
            Event(id=parent, type="slide", tier="event", text=f"Move {i}", segments=(whole,), roles=roles)
        )
        for k, part in enumerate(("grasp", "hold", "move", "release")):
            span = Segment(start_frame=start + k * length // 4, end_frame=start + (k + 1) * length // 4)
            events.append(
                Event(
                    id=f"a{len(events) + 1}",
                    type=part,
                    tier="sub-event",
                    parent=parent,
                    segments=(span,),
                    roles=roles,
                )
            )
    return Layer(objects=objects, events=tuple(events), object_counter=N_OBJECTS, event_counter=N_EVENTS)


def long_session(folder: Path) -> None:
    """A session without media, whose clock was recorded, with two boxes placed in every frame."""
    t_ns = np.arange(N_FRAMES, dtype=np.int64) * STEP_NS
    frame = np.arange(N_FRAMES, dtype=np.int32)
    clock: dict[str, Any] = {"t_ns": t_ns, "frame": frame, "stream": ["color"] * N_FRAMES}
    frames = pa.table(clock).cast(TABLES["frames"].arrow)
    n = 2 * N_FRAMES
    columns: dict[str, Any] = {"t_ns": np.repeat(t_ns, 2), "frame": np.repeat(frame, 2)}
    columns["object_id"] = pa.array(["o1", "o2"] * N_FRAMES).dictionary_encode()
    for field in TABLES["poses"].arrow:
        if pa.types.is_floating(field.type):
            columns[field.name] = np.random.default_rng(0).random(n)
        elif field.name not in columns:
            columns[field.name] = pa.nulls(n, field.type)
    poses = pa.table({name: columns[name] for name in TABLES["poses"].arrow.names}).cast(
        TABLES["poses"].arrow
    )
    manifest = Manifest(
        name="long",
        created="2024-01-01T00:00:00",
        n_frames=N_FRAMES,
        clock=Clock(rule="recorded", duration_ns=int(t_ns[-1])),
        streams=(Stream(name="color", kind="color", n_frames=N_FRAMES, width_px=1920, height_px=1080),),
    )
    tables = {"frames": TableData(data=frames), "poses": TableData(data=poses)}
    create_session(folder, Draft(manifest=manifest, layers=(crowded_layer(),), tables=tables))


@contextmanager
def served(path: Path) -> Generator[tuple[str, str]]:
    """``ecat annotate`` of ``path``: its address and a token."""
    call = [sys.executable, "-m", "ecat", "annotate", str(path), "--port", "0", "--json"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        text = ""
        while not text.endswith("}\n"):
            text += process.stdout.readline()
        said = json.loads(text)
        try:
            yield said["address"], said["token"]
        finally:
            process.terminate()


@contextmanager
def client(address: str, key: str) -> Generator[httpx.Client]:
    """Somebody who shows the same token as the others."""
    with httpx.Client(base_url=address, headers={"authorization": f"Bearer {key}"}, timeout=60) as made:
        yield made


def timed(page: httpx.Client, path: str) -> tuple[float, httpx.Response]:
    """Milliseconds of a GET, and its answer."""
    start = time.perf_counter()
    answer = page.get(path)
    took = 1000 * (time.perf_counter() - start)
    assert answer.status_code == 200, answer.text
    return took, answer


def spread(durations: Sequence[float]) -> str:
    """Median, 95th percentile and maximum of durations in seconds."""
    p50, p95, most = (1000 * float(np.percentile(durations, q)) for q in (50, 95, 100))
    return f"median {p50:6.1f}, p95 {p95:6.1f}, max {most:6.1f} ms"


def one_edit(i: int, chance: random.Random) -> dict[str, Any]:
    """What a person does most: adds, adjusts, names and draws."""
    event = 1 + 5 * chance.randrange(N_EVENTS // 5)
    start = chance.randrange(N_FRAMES - 20)
    return (
        {"op": "add_event", "type": "wave", "tier": "gesture", "segments": [[start, start + 12]]},
        {
            "op": "move_edge",
            "id": f"a{event + 1}",
            "segment": 0,
            "edge": "end",
            "frame": 5 * (event // 5) * 5 + 4 + i % 2,
        },
        {"op": "edit_event", "id": f"a{event}", "text": f"text {i}"},
        {
            "op": "set_key_frame",
            "object": f"o{1 + i % N_OBJECTS}",
            "frame": start,
            "coordinates": [i % 90, 5, 40, 30],
        },
    )[i % 4]


def edit_times(page: httpx.Client, author: str, edits: int, pause_s: float = 0.0) -> tuple[list[float], int]:
    """Seconds until each of some edits was acknowledged, and how many of them were refused."""
    chance, durations, refused = random.Random(author), list[float](), 0
    for i in range(edits):
        body = {"author": author, "operations": [one_edit(i, chance)]}
        start = time.perf_counter()
        answer = page.post(f"{MAIN}/operations", json=body)
        durations.append(time.perf_counter() - start)
        refused += answer.status_code == 422
        assert answer.status_code in {200, 422}, answer.text
        time.sleep(pause_s)
    return durations, refused


def sync_floor(folder: Path) -> list[float]:
    """Seconds of appending 500 bytes to a file and waiting until they are on the disk."""
    durations: list[float] = []
    with (folder / "floor").open("wb", buffering=0) as file:
        for _ in range(100):
            start = time.perf_counter()
            file.write(bytes(500))
            os.fsync(file.fileno())
            durations.append(time.perf_counter() - start)
    return durations


def random_edit(page: httpx.Client, author: str, chance: random.Random, mine: list[str]) -> int:
    """One random operation, of its own events mostly; the status of the answer."""
    kind, start = chance.random(), chance.randrange(N_FRAMES - 50)
    some = chance.choice(mine) if mine else "a1"
    said: dict[str, Any]
    if kind < 0.08 or kind > 0.97:
        way = "undo" if kind < 0.08 else "redo"
        return page.post(f"{MAIN}/{way}", json={"author": author}).status_code
    if kind < 0.35:
        said = {"op": "add_event", "type": author, "segments": [[start, start + 30]]}
    elif kind < 0.55:
        said = {"op": "move_edge", "id": some, "segment": 0, "edge": "end", "frame": start + 30}
    elif kind < 0.7:
        said = {"op": "edit_event", "id": some, "text": f"{author} {chance.random()}"}
    elif kind < 0.78:
        said = {"op": "remove_event", "id": some}
    elif kind < 0.88:
        said = {
            "op": "set_role",
            "id": some,
            "role": "Theme",
            "target": f"o{chance.randrange(N_OBJECTS) + 1}",
        }
    else:
        # what all of them touch
        said = {
            "op": "edit_object",
            "id": f"o{chance.randrange(5) + 1}",
            "name": f"{author} {chance.random()}",
        }
    answer = page.post(f"{MAIN}/operations", json={"author": author, "operations": [said]})
    if answer.status_code == 200 and said["op"] == "add_event":
        mine += [c["id"] for c in answer.json()["record"]["changes"] if c["kind"] == "event"]
    return answer.status_code


def edit_together(address: str, key: str) -> tuple[dict[int, int], float]:
    """Eight clients at once; how often each status was answered, and how many edits a second."""
    statuses: dict[int, int] = {}

    def work(number: int) -> None:
        chance, mine = random.Random(number), list[str]()
        with client(address, key) as page:
            for _ in range(EACH):
                status = random_edit(page, f"p{number}", chance, mine)
                statuses[status] = statuses.get(status, 0) + 1

    threads = [threading.Thread(target=work, args=(number,)) for number in range(CLIENTS)]
    start = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return statuses, CLIENTS * EACH / (time.perf_counter() - start)


def again(journal: Journal, folder: Path) -> Layer:
    """The layer that follows when the operations of a journal are done again, one after the other."""
    long_session(folder)
    with Editor(open_session(folder)) as editor:
        for record, _ in journal.records():
            said = record.operation
            if record.op in {"undo", "redo"}:
                getattr(editor, record.op)(author=record.author)
            else:
                editor.apply(operations_from_list(said.get("operations", [said])), author=record.author)
        return editor.layer


def main() -> None:
    """Print the figures."""
    base = Path(tempfile.mkdtemp())
    try:
        folder = base / "long"
        long_session(folder)
        with served(folder) as (address, key), client(address, key) as page:
            look(page)
            print(f"append and sync                 {spread(sync_floor(base))}")
            edit(page, address, key)
            statuses, per_s = edit_together(address, key)
            print(f"{CLIENTS} clients x {EACH} random operations  {per_s:.0f} a second; answers {statuses}")
            final = page.get(MAIN).json()
        compare(folder, base, final)
    finally:
        shutil.rmtree(base)


def look(page: httpx.Client) -> None:
    """What a page asks for as it opens, at first and again."""
    session = "/api/sessions/long"
    for path in (
        "/api/project",
        session,
        MAIN,
        f"{session}/times/color",
        f"{session}/columns/poses?columns=frame,x,y,z",
    ):
        first, answer = timed(page, path)
        second = min(timed(page, path)[0] for _ in range(3))
        size = len(answer.content) / 1e6
        print(f"GET {path:<55} {first:7.0f} ms, then {second:5.0f} ms, {size:6.2f} MB")


def edit(page: httpx.Client, address: str, key: str) -> None:
    """How soon edits are acknowledged."""
    edit_times(page, "warm", 1)  # the first one writes what the journal begins with
    durations, refused = edit_times(page, "ann", EDITS)
    print(f"edit, one after the other       {spread(durations)} ({refused} refused)")
    saving = threading.Thread(target=lambda: page_save(address, key))
    saving.start()
    durations, _ = edit_times(page, "ann", EDITS // 4, pause_s=0.01)
    saving.join()
    print(f"edit, XML and tables under way  {spread(durations)}")


def page_save(address: str, key: str) -> None:
    """A checkpoint now."""
    with client(address, key) as page:
        start = time.perf_counter()
        assert page.post(f"{MAIN}/save", json={}).status_code == 200
        print(f"checkpoint                      {time.perf_counter() - start:.1f} s")


def compare(folder: Path, base: Path, final: dict[str, Any]) -> None:
    """Whether what was served last, what is saved, and the journal done again are the same."""
    from ecat.web.layers import layer_json

    saved = open_session(folder).layer()
    serial = again(Journal(folder, "main"), base / "again" / "long")
    try:
        same = layer_json(saved) == final["layer"] and layer_json(serial) == final["layer"]
    except EcatError as error:
        print(error)
        same = False
    print(f"final state = serial order of the journal's {final['revision']} records: {same}")


if __name__ == "__main__":
    main()
