"""``kill -9`` at any instant loses nothing that was acknowledged, and many at once lose nothing of each other's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from ecat.annotate import Editor
from ecat.store import Session, leftovers, remove_leftovers
from tests.annotate.bench import do, thing

KILLS = int(os.environ.get("ECAT_TEST_KILLS", "20"))
"""How many annotators are killed at random instants; more find rarer faults."""


def annotators(*words: object) -> Any:
    """What :mod:`tests.annotate.annotators` found."""
    command = [sys.executable, "-m", "tests.annotate.annotators", *map(str, words)]
    root = Path(__file__).parents[2]
    run = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False, timeout=600)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_after_a_kill_everything_acknowledged_is_there_and_the_session_opens_without_repair(
    session: Session,
) -> None:
    last = 0
    for found in annotators("kills", KILLS, session.path):
        assert "failure" not in found, found
        # a step may be on the disk and not acknowledged yet
        assert last <= found["acknowledged"] or found["acknowledged"] == 0
        assert max(last, found["acknowledged"]) <= found["found"] <= max(last, found["acknowledged"]) + 1
        assert found["same"]
        assert found["faults"] == []
        last = found["found"]
    assert last > KILLS
    assert all(path.name.endswith(".new") for path in leftovers(session.path))
    remove_leftovers(session.path)


def test_the_steps_of_many_at_once_are_all_there_in_one_order(session: Session) -> None:
    with Editor(session) as editor:
        do(editor, thing("cup", "rectangle", frame=0, coordinates=[1, 2, 3, 4]))
    found = annotators("many", 3, 25, session.path)
    assert found["said"] == ["25"] * 3
    assert found["steps"] == 76
    assert found["by_author"] == [1, 25, 25, 25]
    assert found["same"]
    assert found["faults"] == []
