"""Processes that annotate one layer at random: killed at any instant, or many at once.

Forking from one that has imported everything takes milliseconds where a new interpreter takes a second:

    python -m tests.annotate.annotators kills <n> <path>          kill so many, one after the other
    python -m tests.annotate.annotators many <n> <steps> <path>   so many at once, so many steps each

Prints one line of JSON: what was found after each kill, or at the end.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

from ecat.annotate import Editor, operation_from_dict
from ecat.errors import ConflictError, EcatError, OperationError
from ecat.store import Journal, open_session, validate
from tests.annotate.anything import anything

LAYER = "main"
LEAST_WAIT_S, MOST_WAIT_S = 0.0, 0.12


def step(editor: Editor, chance: Random) -> None:
    """One random step, which may be refused."""
    kind = chance.randrange(12)
    with contextlib.suppress(OperationError, ConflictError):
        if kind == 0:
            editor.undo()
        elif kind == 1:
            editor.redo()
        elif kind == 2 and chance.randrange(8) == 0:
            editor.restore(chance.randint(0, editor.revision))
        else:
            asked = anything(chance, editor.layer)
            if asked["op"] not in {"accept_proposal", "reject_proposal", "copy_objects"}:
                editor.apply(operation_from_dict(asked))


def child(work: Callable[[int], None]) -> tuple[int, int]:
    """Do ``work`` in a process of its own: its pid, and what it writes to the descriptor that it is given."""
    reader, writer = os.pipe()
    pid = os.fork()
    if pid:
        os.close(writer)
        return pid, reader
    try:
        os.close(reader)
        work(writer)
    except BaseException as error:  # noqa: BLE001 - whatever it is, the child must not go on as the parent
        os.write(writer, f"failure {error!r}\n".encode())
    os._exit(0)


def text_of(reader: int) -> str:
    """Everything that a child has written, once it is gone."""
    with os.fdopen(reader, "rb") as file:
        return file.read().decode()


def until_killed(path: Path, author: str, chance: Random) -> Callable[[int], None]:
    """Annotate for ever, saving now and then, and write the revision of each step that was acknowledged."""

    def work(writer: int) -> None:
        editor = Editor(open_session(path), LAYER, author)
        while True:
            before = editor.revision
            step(editor, chance)
            if editor.revision > before:
                os.write(writer, f"{editor.revision}\n".encode())
            if chance.randrange(10) == 0:
                editor.save()

    return work


def kill(path: Path, chance: Random) -> dict[str, Any]:
    """Kill one annotator at a random instant, and look at what is left."""
    pid, reader = child(until_killed(path, f"ann{chance.randrange(3)}", chance))
    select.select([reader], [], [], 30.0)
    time.sleep(chance.uniform(LEAST_WAIT_S, MOST_WAIT_S))
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    lines = text_of(reader).split("\n")[:-1]
    if lines and lines[-1].startswith("failure"):
        return {"failure": lines[-1]}
    last = int(lines[-1]) if lines else 0
    try:
        opened = open_session(path)
        layer, place = Journal(path, LAYER).replay()
        return {
            "acknowledged": last,
            "found": place.revision,
            "same": opened.layer(LAYER) == layer,
            "faults": list(map(str, validate(opened))),
        }
    except EcatError as error:
        return {"failure": str(error)}


def kills(n: int, path: Path) -> list[dict[str, Any]]:
    """Kill ``n`` annotators, one after the other."""
    chance = Random(0)
    return [kill(path, Random(chance.randrange(2**32))) for _ in range(n)]


def many(n: int, steps: int, path: Path) -> dict[str, Any]:
    """Let ``n`` annotators do ``steps`` steps each at once, and look at what is left."""

    def work(author: str, seed: int) -> Callable[[int], None]:
        def annotate(writer: int) -> None:
            editor, chance, done = Editor(open_session(path), LAYER, author), Random(seed), 0
            while done < steps:
                before = editor.revision
                step(editor, chance)
                mine = [r for r in editor.history(before + 1, 10**6) if r.author == author]
                done += len(mine)
            os.write(writer, f"{done}\n".encode())

        return annotate

    children = [child(work(f"ann{i}", i)) for i in range(n)]
    said = [text_of(reader).strip() for _, reader in children]
    for pid, _ in children:
        os.waitpid(pid, 0)
    opened = open_session(path)
    layer, place = Journal(path, LAYER).replay()
    authors = [record.author for record, _ in Journal(path, LAYER).records(changes=False)]
    return {
        "said": said,
        "steps": place.revision,
        "by_author": sorted(authors.count(name) for name in set(authors)),
        "same": opened.layer(LAYER) == layer,
        "faults": list(map(str, validate(opened))),
    }


if __name__ == "__main__":
    command, *numbers, place = sys.argv[1:]
    found = {"kills": kills, "many": many}[command](*map(int, numbers), Path(place))  # type: ignore[operator]
    sys.stdout.write(json.dumps(found) + "\n")
