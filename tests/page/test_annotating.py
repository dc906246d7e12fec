"""From nothing to an annotated demonstration, with assertions on what is on the disk."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ecat.model import Event, Layer
from ecat.store import open_session


def _spans(layer: Layer) -> dict[str, tuple[int, int]]:
    return {e.type: (e.segments[0].start_frame, e.segments[-1].end_frame) for e in layer.events}


def _roles(event: Event) -> dict[str, str]:
    return {role.name: role.target for role in event.roles}


def _event(layer: Layer, kind: str) -> Event:
    return next(event for event in layer.events if event.type == kind)


def _label_a_slide(window: Any) -> None:
    """Parts first, then what they are parts of: one key each, at the frames where a practised person would press."""
    for frame, key in ((20, "1"), (40, "2"), (60, "3"), (90, "4"), (110, "5")):
        window.at(frame)
        window.press(key)


def test_from_nothing_to_a_confirmed_event_killed_reopened_undone_exported(
    served: Any, window: Callable[..., Any], annotating: Any, tmp_path: Path
) -> None:
    annotating.find("tab-objects").click()
    annotating.find("row-o2").click()
    _label_a_slide(annotating)
    assert annotating.says("app.primary.kind") == "event"
    _state_a_relation(annotating)
    # the browser is gone in the middle of it: nothing that was shown as saved may be lost
    annotating.page.context.close()
    again = window(served)
    assert again.says("app.document.events.list.length") == 5
    assert again.says("app.document.relations.list.map(r => r.predicate)") == ["NEAR"]
    again.page.reload()
    again.opened()

    _until_nothing_is_left(again, "Control+z", "canUndo")
    assert again.says("app.document.events.list.length + app.document.relations.list.length") == 0
    _until_nothing_is_left(again, "Control+Shift+z", "canRedo")
    assert again.complaints == []

    layer = served.layer()
    assert _spans(layer) == {
        "slide_next": (20, 110),
        "grasp": (20, 40),
        "hold": (40, 60),
        "move": (60, 90),
        "release": (90, 110),
    }
    whole = _event(layer, "slide_next")
    assert {e.parent for e in layer.events if e is not whole} == {whole.id}
    assert {e.status for e in layer.events} == {"confirmed"}
    assert _roles(whole) == {"Theme": "o2", "Agent": "o1"}
    assert [(r.predicate, r.targets) for r in layer.relations] == [("NEAR", ("o2", "o3"))]
    _exports(served.path, tmp_path / "old", layer)


def _until_nothing_is_left(window: Any, key: str, can: str) -> None:
    for _ in range(50):
        if not window.says(f"app.active.{can}"):
            return
        window.press(key)
    pytest.fail(f"{can} stays true")


def _state_a_relation(window: Any) -> None:
    window.find("tab-relations").click()
    window.find("new-predicate").fill("NEAR")
    window.find("new-argument-1").select_option("o2")
    window.find("new-argument-2").select_option("o3")
    window.find("add-relation").click()
    window.settle()


def _exports(session: Path, dest: Path, layer: Layer) -> None:
    """The session as the program of 2018 wrote it says the same."""
    ecat = [sys.executable, "-m", "ecat"]
    subprocess.run(
        [*ecat, "export", str(session), str(dest), "--format", "ecat-2018", "-q"],
        check=True,
        capture_output=True,
    )
    subprocess.run(
        [*ecat, "import", str(dest), str(dest.parent / "back"), "-q"], check=True, capture_output=True
    )
    back = open_session(dest.parent / "back").layer("main")
    assert sorted(_spans_of(back)) == sorted(_spans_of(layer))
    assert [(r.predicate, r.targets) for r in back.relations] == [
        (r.predicate, r.targets) for r in layer.relations
    ]


def _spans_of(layer: Layer) -> list[tuple[int, int]]:
    return [(e.segments[0].start_frame, e.segments[-1].end_frame) for e in layer.events]


class Counted:
    """Presses keys and clicks, and counts them."""

    def __init__(self, window: Any) -> None:
        self.window = window
        self.n = 0

    def press(self, *keys: str) -> None:
        self.n += len(keys)
        self.window.press(*keys)

    def drag(self, *points: tuple[float, float]) -> None:
        self.n += 1
        mouse = self.window.page.mouse
        mouse.move(*points[0])
        mouse.down()
        mouse.move(*points[1], steps=4)
        mouse.up()
        self.window.settle()


def test_a_demonstration_takes_at_most_twelve_keystrokes_or_clicks(served: Any, annotating: Any) -> None:
    annotating.at(10)
    hand = Counted(annotating)
    hand.press("r")
    box = annotating.find("overlay").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    hand.drag((x - 40, y - 30), (x + 40, y + 30))
    hand.press("c", "u", "p", "Enter")
    for frame, key in ((20, "1"), (40, "2"), (60, "3"), (90, "4"), (110, "5")):
        # what playing does between the keys; the recording does not wait for a slow machine
        annotating.at(frame)
        hand.press(key)
    assert hand.n <= 12

    layer = served.layer()
    cup = next(thing for thing in layer.objects if thing.name == "cup")
    whole = _event(layer, "slide_next")
    assert [
        e.type for e in sorted(layer.events, key=lambda e: e.segments[0].start_frame) if e.parent == whole.id
    ] == ["grasp", "hold", "move", "release"]
    assert _roles(whole)["Theme"] == cup.id
    assert whole.segments[0].start_frame == 20
    assert whole.segments[0].end_frame == 110


def test_labels_follow_the_keys_while_it_plays(served: Any, annotating: Any) -> None:
    annotating.press(" ", "5", "1")
    annotating.until("app.cursor.frame > 12")
    annotating.press("2")
    annotating.until("app.cursor.frame > 24")
    annotating.press("5", " ")
    layer = served.layer()
    grasp, hold, slide = (_event(layer, kind) for kind in ("grasp", "hold", "slide_next"))
    assert grasp.segments[0].end_frame == hold.segments[0].start_frame
    assert hold.segments[0].end_frame == slide.segments[0].end_frame
    assert grasp.parent == hold.parent == slide.id


def test_an_event_is_split_merged_nudged_and_called_unsure_by_single_keys(
    served: Any, annotating: Any
) -> None:
    annotating.at(10)
    annotating.press("i")
    annotating.at(50)
    annotating.press("o", "e")
    assert annotating.says("app.selectedEvent.segments.map(s => [s.start_frame, s.end_frame])") == [[10, 50]]
    annotating.press("]", "]", "{", "u")
    annotating.at(30)
    annotating.press("s", "m", "n")
    layer = served.layer()
    spans = sorted(_spans_of(layer))
    assert (12, 49) in spans
    parent = next(e for e in layer.events if e.parent is None)
    assert parent.unsure
    assert [e.parent for e in layer.events if e is not parent] == [parent.id]


def test_a_text_refers_to_objects_as_whole_words(served: Any, annotating: Any) -> None:
    annotating.press("e")
    annotating.find("event-text").fill("The Shell box passes the shells of Stella Artois")
    annotating.find("event-text").blur()
    annotating.settle()
    annotating.find("find-references").click()
    annotating.settle()
    annotating.find("reference-o3").click()
    assert annotating.says("app.selectedObject.name") == "Stella Artois"
    event = served.layer().events[0]
    assert [(event.text[r.start : r.end], r.target) for r in event.references] == [
        ("Shell", "o2"),
        ("Stella Artois", "o3"),
    ]


def test_any_revision_can_be_brought_back_from_the_history(served: Any, annotating: Any) -> None:
    annotating.press("e")
    annotating.at(60)
    annotating.press("e")
    annotating.press("Delete")
    annotating.find("history-button").click()
    annotating.find("revision-2").click()
    annotating.find("restore").click()
    annotating.settle()
    assert annotating.says("app.document.events.list.length") == 2
    assert len(served.layer().events) == 2


@pytest.mark.parametrize("existing", ["add", "clear"])
def test_windows_are_laid_over_the_recording(served: Any, annotating: Any, existing: str) -> None:
    annotating.press("e")
    annotating.find("windows-button").click()
    annotating.find("windows-step").fill("50")
    annotating.find("windows-duration").fill("50")
    annotating.find("windows-existing").select_option(existing)
    annotating.find("windows-yes").click()
    annotating.settle()
    layer = served.layer()
    n = (served.session().manifest.n_frames - 50) // 50 + 1
    assert len(layer.events) == n + (existing == "add")
