"""Several people at once: nothing is lost, and what there is follows from the journal alone."""

from __future__ import annotations

import random
import shutil
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecat.annotate import Editor, operations_from_list
from ecat.store import Journal, open_session
from ecat.web import Server
from ecat.web.layers import layer_json
from tests.web.conftest import entered

if TYPE_CHECKING:
    from tests.web.conftest import Browser

PEOPLE, EACH = 4, 25
N_FRAMES = 180


def random_edit(browser: Browser, author: str, chance: random.Random, known: list[str]) -> int:
    """An edit of what anybody made, with or without saying what it is based on; the status of the answer."""
    kind, start = chance.random(), chance.randrange(N_FRAMES - 20)
    if kind < 0.15:
        return browser.post(f"layers/main/{chance.choice(['undo', 'redo'])}", {"author": author}).status_code
    some = chance.choice(known) if known else "a1"
    kinds: list[dict[str, Any]] = [
        {"op": "add_event", "type": author, "segments": [[start, start + 10]]},
        {"op": "add_object", "kind": "point", "name": author, "frame": start, "coordinates": [start, 5]},
        {"op": "edit_event", "id": some, "text": f"{author} {start}"},
        {"op": "set_segments", "id": some, "segments": [[start, start + 5]]},
        {"op": "remove_event", "id": some},
    ]
    (said,) = chance.choices(kinds, (5, 2, 2, 2, 1))
    base = browser.json("layers/main/history?limit=0")["revision"] if kind > 0.7 else None
    answer = browser.post("layers/main/operations", {"author": author, "operations": [said], "base": base})
    if answer.status_code == 200:
        known += [c["id"] for c in answer.json()["record"]["changes"] if c["kind"] == "event"]
    return answer.status_code


def test_the_final_state_is_that_of_the_journals_operations_done_one_after_the_other(
    project: Path, tmp_path: Path
) -> None:
    untouched = Path(shutil.copytree(project / "slide", tmp_path / "again"))
    statuses: list[int] = []

    def work(server: Server, number: int) -> None:
        chance, known = random.Random(number), list[str]()
        with entered(server) as browser:
            statuses.extend(random_edit(browser, f"p{number}", chance, known) for _ in range(EACH))

    with Server(project, port=0).running() as server:
        threads = [threading.Thread(target=work, args=(server, number)) for number in range(PEOPLE)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        with entered(server) as browser:
            final = browser.json("layers/main")
    assert set(statuses) <= {200, 409, 422}
    # how many conflict depends on who comes first
    assert statuses.count(200) > len(statuses) / 5

    records = [record for record, _ in Journal(project / "slide", "main").records()]
    assert [record.revision for record in records] == list(range(1, final["revision"] + 1))
    with Editor(open_session(untouched)) as editor:
        for record in records:
            if record.op in {"undo", "redo"}:
                getattr(editor, record.op)(author=record.author)
            else:
                editor.apply(operations_from_list([record.operation]), author=record.author)
        assert layer_json(editor.layer) == final["layer"]
    assert layer_json(open_session(project / "slide").layer()) == final["layer"]


def test_of_two_edits_based_on_the_same_revision_one_wins_and_the_other_is_told(browser: Browser) -> None:
    answers: list[Any] = []

    def work(author: str) -> None:
        with entered(browser.server) as mine:
            said = [{"op": "add_event", "type": author, "segments": [[1, 5]]}]
            body = {"author": author, "operations": said, "base": 0}
            answers.append(mine.post("layers/main/operations", body))

    threads = [threading.Thread(target=work, args=(f"p{i}",)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    won, *lost = sorted(answers, key=lambda answer: answer.status_code)
    assert won.status_code == 200
    assert {answer.status_code for answer in lost} == {409}
    for answer in lost:
        assert answer.json()["records"] == [won.json()["record"]]
