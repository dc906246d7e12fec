"""A process that makes processes that write, for the tests to kill: ``python -m tests.store.writers``.

Forking from one that has imported everything takes milliseconds where a new interpreter takes a second.
Commands come one a line; every answer is one line, the last of a command ``end``.

    once <step> <action> <path>     do it, dying by SIGKILL before step number <step>
    loop <action> <path>            answer ``pid <n>``, then do it for ever, with an ``ack <number>`` each
    limit <bytes> <action> <path>   do it where no file may grow beyond so many bytes
    both <n> <path>                 two processes add one to the session's number, <n> times each
"""

from __future__ import annotations

import itertools
import os
import resource
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from ecat.errors import EcatError, LockedError, StaleError
from ecat.model.record import Record
from ecat.store import Journal, create_session, files, open_session, rebuild_layer
from ecat.store.journal import START
from tests.store.sessions import draft, layer, make, number_of, write


def commit(path: Path) -> int:
    """Add one to the session's number."""
    session = open_session(path)
    number = number_of(session) + 1
    write(session, number)
    return number


def create(path: Path) -> int:
    """Make the next session in a folder of them."""
    number = sum(not inner.name.startswith(".") for inner in path.iterdir())
    create_session(path / f"s{number}", draft(number))
    return number


def journal(path: Path) -> int:
    """Append the next record to the journal."""
    with Journal(path, "main").hold() as held:
        news = held.news(START)
        place = news[-1][1] if news else START
        new = Record(revision=place.revision + 1, author="", time="", operation={"op": "x"})
        held.append(place, [new], base=layer())
    return new.revision


def rebuild(path: Path) -> int:
    """Write the XML of the layer anew."""
    rebuild_layer(open_session(path), "main")
    return 0


def add(path: Path, times: int) -> int:
    """Add one to the session's number, ``times`` times, whoever else does the same."""
    session = open_session(path)
    done = 0
    while done < times:
        try:
            write(session.refresh(), number_of(session) + 1)
            done += 1
        except (StaleError, LockedError):
            continue
    return done


ACTIONS: dict[str, Callable[[Path], int]] = {
    "commit": commit,
    "create": create,
    "journal": journal,
    "rebuild": rebuild,
}


def say(line: str) -> None:
    """One answer, in one write."""
    os.write(1, f"{line}\n".encode())


def die_before(step: int) -> None:
    """Let this process be killed before its step number ``step``."""
    count = itertools.count()

    def perhaps(action: str, path: Path) -> None:
        if next(count) == step:
            os.kill(os.getpid(), signal.SIGKILL)

    files.step = perhaps


def child(work: Callable[[], None]) -> int:
    """Do ``work`` in a process of its own."""
    pid = os.fork()
    if pid:
        return pid
    try:
        work()
    except EcatError as error:
        say(f"error {type(error).__name__}")
    except BaseException as error:  # noqa: BLE001 - whatever it is, the child must not go on as the parent
        say(f"failure {error!r}")
    os._exit(0)


def answer(command: str, arguments: list[str]) -> None:
    """Carry out one command."""
    path = Path(arguments[-1])
    if command == "once":
        step, action = int(arguments[0]), arguments[1]

        def once() -> None:
            die_before(step)
            ACTIONS[action](path)
            say("done")

        pids = [child(once)]
    elif command == "limit":
        limit, action = int(arguments[0]), arguments[1]

        def limited() -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
            ACTIONS[action](path)

        pids = [child(limited)]
    elif command == "loop":
        action = ACTIONS[arguments[0]]

        def forever() -> None:
            say(f"pid {os.getpid()}")  # the child itself, so that no other answer comes before
            while True:
                say(f"ack {action(path)}")

        pids = [child(forever)]
    else:
        times = int(arguments[0])
        pids = [child(lambda: say(f"done {add(path, times)}")) for _ in range(2)]
    for pid in pids:
        os.waitpid(pid, 0)
    say("end")


if __name__ == "__main__":
    # what is built at first use is built here, once, so that the children are quick
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder) / "s")
        commit(Path(folder) / "s")
    for line in sys.stdin:
        answer(line.split()[0], line.split()[1:])
