"""Everything that the page does, typed: objects, events, relations, proposals, undo, history, scripts."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from ecat.model import Clock, Manifest, Stream
from ecat.store import Draft, create_session, open_session

if TYPE_CHECKING:
    from conftest import Ecat


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    """A recording of 300 images in ten seconds that nobody has annotated."""
    manifest = Manifest(
        name="empty",
        created="2026-01-01T00:00:00Z",
        n_frames=300,
        clock=Clock(rule="uniform", duration_ns=10_000_000_000),
        streams=(Stream(name="color", kind="color", file="media/color.mp4", n_frames=300),),
    )
    create_session(tmp_path / "empty", Draft(manifest=manifest))
    return tmp_path / "empty"


def added(ecat: Ecat, *args: object) -> list[str]:
    """Ids of what a verb added."""
    result = ecat(*args, "--json", "--author", "ann")
    assert result.code == 0, result.out
    return result.json["added"]


def test_from_nothing_to_an_event_with_sub_events_and_a_relation_and_back(
    ecat: Ecat, empty: Path, tmp_path: Path
) -> None:
    [mug] = added(
        ecat, "object", "add", empty, "--name", "mug", "--kind", "rectangle", "--frame", 10,
        "--shape", "320,200,64,48",
    )[:1]  # fmt: skip
    [plate] = added(ecat, "object", "add", empty, "--name", "plate", "--kind", "point")
    [event] = added(
        ecat, "event", "add", empty, "--type", "slide", "--span", "30:90", "--role", f"Theme={mug}",
        "--text", "Ann slides the mug to the plate",
    )  # fmt: skip
    for part, start, end in (("grasp", 30, 40), ("hold", 40, 80), ("release", 80, 90)):
        added(ecat, "event", "add", empty, "--type", part, "--span", f"{start}:{end}", "--parent", event)
    added(ecat, "relation", "add", empty, "NEAR", mug, plate, "--from", 85)
    assert ecat("event", "find-references", empty, "--author", "ann").code == 0

    layer = open_session(empty).layer("main")
    slide = layer.events[0]
    assert [(r.name, r.target) for r in slide.roles] == [("Theme", mug)]
    assert {slide.text[r.start : r.end] for r in slide.references} == {"mug", "plate"}
    assert [e.parent for e in layer.events[1:]] == [event] * 3
    assert open_session(empty).relations.to_pandas()["predicate"].tolist() == ["NEAR"]

    listed = ecat("event", "list", empty)
    assert "Ann slides the mug" in listed.out
    assert ecat("export", empty, tmp_path / "back", "--format", "ecat-2018").code == 0

    steps = ecat("log", empty, "--json").json["records"]
    assert ecat("undo", empty, "--author", "ann", "--steps", len(steps)).code == 0
    undone = open_session(empty).layer("main")
    assert (undone.objects, undone.events, undone.relations) == ((), (), ())
    assert ecat("redo", empty, "--author", "ann", "--steps", len(steps)).code == 0
    assert open_session(empty).layer("main").events == layer.events


def test_times_may_stand_for_frames(ecat: Ecat, empty: Path) -> None:
    added(ecat, "event", "add", empty, "--type", "slide", "--span", "1s:2.5s")
    [segment] = open_session(empty).layer("main").events[0].segments
    assert (segment.start_frame, segment.end_frame) == (30, 75)


@pytest.mark.parametrize(
    ("args", "field", "value"),
    [
        (("edit", "a1", "--type", "push", "--unsure"), "type", "push"),
        (("edit", "a1", "--sure"), "unsure", False),
        (("edge", "a1", "end", "95"), "segments", [(30, 95)]),
        (("span", "a1", "10:20", "40:50"), "segments", [(10, 20), (40, 50)]),
        (("shift", "a1", "--frames", "-5"), "segments", [(25, 85)]),
        (("split", "a1", "60"), "segments", [(30, 60)]),
        (("merge", "a1", "a2"), "segments", [(30, 130)]),
        (("link", "a1", "CAUSE", "a2"), "links", [("CAUSE", "a2")]),
        (("role", "a1", "Theme", "o1"), "roles", [("Theme", "o1")]),
        (("slots", "a1", "--subject", "o1", "--verb", "pull"), "type", "pull"),
        (("refer", "a1", "0:3", "o1"), "references", [(0, 3, "o1")]),
    ],
)
def test_an_event_is_changed_and_only_it(
    ecat: Ecat, empty: Path, args: tuple[str, ...], field: str, value: object
) -> None:
    added(ecat, "object", "add", empty, "--name", "mug", "--kind", "point")
    added(ecat, "event", "add", empty, "--type", "slide", "--span", "30:90", "--text", "mug slides")
    added(ecat, "event", "add", empty, "--type", "slide", "--span", "90:130")
    verb, *rest = args
    assert ecat("event", verb, empty, *rest).code == 0
    event = open_session(empty).layer("main").events[0]
    found: Any = getattr(event, field)
    short = {
        "segments": lambda: [(s.start_frame, s.end_frame) for s in found],
        "links": lambda: [(link.type, link.target) for link in found],
        "roles": lambda: [(role.name, role.target) for role in found],
        "references": lambda: [(r.start, r.end, r.target) for r in found],
    }.get(field, lambda: found)
    assert short() == value


@pytest.mark.parametrize(
    ("args", "expected"),
    [
        (("draw", "o1", "50", "--shape", "1,2,3,4"), [(10, True), (50, True)]),
        (("absent", "o1", "50"), [(10, True), (50, False)]),
        (("erase", "o1", "10"), []),
        (("edit", "o1", "--name", "cup"), [(10, True)]),
        (("property", "o1", "material", "clay"), [(10, True)]),
    ],
)
def test_an_object_is_drawn_and_described(
    ecat: Ecat, empty: Path, args: tuple[str, ...], expected: list[tuple[int, bool]]
) -> None:
    added(
        ecat,
        "object",
        "add",
        empty,
        "--name",
        "mug",
        "--kind",
        "rectangle",
        "--frame",
        10,
        "--shape",
        "9,9,9,9",
    )
    verb, *rest = args
    assert ecat("object", verb, empty, *rest).code == 0
    thing = open_session(empty).layer("main").objects[0]
    assert [(key.frame, key.present) for key in thing.key_frames] == expected


def test_what_holds_at_a_frame_can_be_asked(ecat: Ecat, empty: Path) -> None:
    for name in ("mug", "plate"):
        added(ecat, "object", "add", empty, "--name", name, "--kind", "other")
    added(ecat, "relation", "add", empty, "ON", "o1", "o2", "--from", 10, "--to", 20)
    ids = [row["id"] for row in ecat("relation", "list", empty, "--at", 15, "--json").json["relations"]]
    assert len(ids) == 1
    assert ecat("relation", "list", empty, "--at", "20", "--json").json["relations"] == []
    assert ecat("relation", "edit", empty, ids[0], "--to", 30).code == 0
    assert ecat("relation", "list", empty, "--at", 25, "--json").json["relations"]
    assert ecat("relation", "remove", empty, ids[0]).code == 0
    assert open_session(empty).layer("main").relations == ()


def test_windows_are_made_once(ecat: Ecat, empty: Path) -> None:
    windows = ("event", "windows", empty, "--step", 5, "--duration", 20, "--tier", "window")
    assert len(added(ecat, *windows)) == (300 - 20) // 5 + 1
    assert added(ecat, *windows) == []


def test_a_script_is_applied_line_by_line_or_as_one_step(ecat: Ecat, empty: Path, tmp_path: Path) -> None:
    script = tmp_path / "edits.jsonl"
    lines = [{"op": "add_event", "type": "slide", "segments": [[k, k + 5]]} for k in range(0, 50, 10)]
    script.write_text("\n".join(map(json.dumps, lines)))
    assert ecat("apply", empty, script, "--json").json["revision"] == 5
    script.write_text(json.dumps(lines))
    assert ecat("apply", empty, script, "--one-step", "--json").json["revision"] == 6
    assert len(open_session(empty).layer("main").events) == 10
    log = ecat("log", empty, "--last", 1)
    assert log.out.startswith("6 ")


@pytest.mark.parametrize(
    "script",
    [
        "nonsense",
        '{"op": "explode"}',
        '{"op": "add_event", "segments": "x"}',
        '{"op": "add_event"}\n3',
        "[" * 50_000,
        "\x00",
    ],
)
def test_a_broken_script_changes_nothing(ecat: Ecat, empty: Path, tmp_path: Path, script: str) -> None:
    (tmp_path / "edits.jsonl").write_text(script)
    result = ecat("apply", empty, tmp_path / "edits.jsonl")
    assert result.code == 1
    assert len(result.err.splitlines()) >= 4
    assert open_session(empty).manifest.layers == ()


def test_the_operation_that_a_script_stops_at_is_named(ecat: Ecat, empty: Path, tmp_path: Path) -> None:
    script = tmp_path / "edits.jsonl"
    good = {"op": "add_event", "type": "slide", "segments": [[1, 5]]}
    script.write_text("\n".join(map(json.dumps, [good, good, {"op": "remove_event", "id": "a9"}, good])))
    told = ecat("apply", empty, script, "--json").json["error"]
    assert told["where"].startswith(f"{script}: operation 3 of 4\n")
    assert told["consequence"] == "the 2 operations before it stay, and nothing else was changed"
    assert (
        ecat("apply", empty, script, "--one-step", "--json").json["error"]["consequence"]
        == "nothing was changed"
    )
    assert len(open_session(empty).layer("main").events) == 2


def test_any_revision_comes_back(ecat: Ecat, empty: Path) -> None:
    for kind in ("slide", "push", "pull"):
        added(ecat, "event", "add", empty, "--type", kind, "--span", "1:2")
    assert ecat("restore", empty, 1).code == 0
    assert [event.type for event in open_session(empty).layer("main").events] == ["slide"]
    assert ecat("undo", empty).code == 0
    assert len(open_session(empty).layer("main").events) == 3


@pytest.mark.parametrize(
    ("args", "code"),
    [
        (("event", "add", "--span", "20:10"), 1),
        (("event", "add", "--span", "20"), 2),
        (("event", "add", "--span", "10:400"), 1),
        (("event", "edit", "a9", "--type", "x"), 1),
        (("event", "add", "--span", "1:x"), 2),
        (("event", "add", "--span", "1:2", "--role", "Theme"), 2),
        (("object", "draw", "o1", "1", "--shape", "a,b"), 2),
        (("object", "add", "--kind", "cloud"), 2),
        (("relation", "add", "ON", "o1", "o2", "--from", "0"), 1),
        (("proposal", "accept", "machine/p1"), 1),
        (("scheme", "set", "nothing"), 1),
        (("undo",), 1),
        (("log", "--layer", "nobody"), 1),
    ],
)
def test_what_cannot_be_done_is_one_error_that_says_what_to_try(
    ecat: Ecat, empty: Path, args: tuple[str, ...], code: int
) -> None:
    at = 1 if args[0] in {"undo", "log"} else 2
    result = ecat(*args[:at], empty, *args[at:])
    assert result.code == code, result.err
    assert "Traceback" not in result.err
    assert any(line.strip().startswith("try:") for line in result.err.splitlines())


def test_proposals_are_listed_accepted_and_rejected(ecat: Ecat, session: Path) -> None:
    assert ecat("process", session).code == 0
    rows = ecat("proposal", "list", session, "--json").json["proposals"]
    events = [row["proposal"] for row in rows if row["kind"] == "event"]
    facts = [row["proposal"] for row in rows if row["kind"] == "relation"]
    assert ecat("proposal", "accept", session, events[0], "--layer", "ann", "--author", "ann").code == 0
    assert ecat("proposal", "reject", session, facts[0], "--layer", "ann", "--author", "ann").code == 0
    layer = open_session(session).layer("ann")
    assert layer.events[0].status == "confirmed"
    assert all(event.parent == layer.events[0].id for event in layer.events[1:])
    decided = {
        row["proposal"]: row["decision"]
        for row in ecat("proposal", "list", session, "--layer", "ann", "--json").json["proposals"]
    }
    assert (decided[events[0]], decided[facts[0]]) == ("accepted", "rejected")
    still = ecat("proposal", "list", session, "--layer", "ann", "--open", "--json").json["proposals"]
    assert len(still) == len(rows) - 2


def test_a_scheme_is_imported_shown_set_and_exported(
    ecat: Ecat, empty: Path, tmp_path: Path, shared: Path
) -> None:
    program = shared / "ecat_program"
    assert ecat("scheme", "import", empty, program / "option.txt", "--name", "lab").code == 0
    assert ecat("scheme", "import", empty, program / "square_table.xml", "--name", "lab").code == 0
    shown = ecat("scheme", "show", empty, "lab")
    assert "LOOK_AT" in shown.out
    assert "object types" in shown.out
    assert ecat("scheme", "set", empty, "lab").code == 0
    assert open_session(empty).layer("main").scheme == "lab"
    dest = tmp_path / "lab.scheme.xml"
    assert ecat("scheme", "export", empty, "lab", dest).code == 0
    assert ecat("scheme", "import", empty, dest, "--name", "copy").code == 0
    assert "copy" in ecat("scheme", "list", empty).out


def test_a_file_that_is_no_scheme_is_refused(ecat: Ecat, empty: Path, tmp_path: Path) -> None:
    (tmp_path / "x.xml").write_text("<html/>")
    result = ecat("scheme", "import", empty, tmp_path / "x.xml")
    assert result.code == 1
    assert "neither a coding scheme" in result.err


def test_words_that_name_actions_are_marked_and_unmarked(ecat: Ecat, empty: Path) -> None:
    [event] = added(ecat, "event", "add", empty, "--span", "1:9", "--text", "slides and drops it")
    assert ecat("event", "actions", empty, event, "0:6=slide", "11:16=drop").code == 0
    [found] = open_session(empty).layer("main").events
    assert [(found.text[p.start : p.end], p.type) for p in found.predicates] == [
        ("slides", "slide"),
        ("drops", "drop"),
    ]
    assert ecat("event", "actions", empty, event).code == 0
    assert open_session(empty).layer("main").events[0].predicates == ()


@pytest.fixture
def project(ecat: Ecat, empty: Path) -> Path:
    """Two sessions of nobody's, and one that cannot be read."""
    project = empty.parent / "project"
    assert ecat("project", "new", project).code == 0
    for name in ("a", "b", "broken"):
        shutil.copytree(empty, project / name)
    (project / "broken" / "session.json").write_text("{")
    return project


def test_windows_of_a_whole_project(ecat: Ecat, project: Path) -> None:
    result = ecat("event", "windows", project, "--step", 100, "--duration", 50, "--tier", "window", "--json")
    assert result.code == 1, "what stops one session does not stop the others"
    assert [(row["session"], row["changes"]) for row in result.json["sessions"]] == [("a", 3), ("b", 3)]
    assert [row["session"] for row in result.json["failures"]] == ["broken"]
    for name in ("a", "b"):
        starts = [e.segments[0].start_frame for e in open_session(project / name).layer().events]
        assert starts == [0, 100, 200]
    words = ("event", "windows", project, "--step", 90, "--duration", 50, "--tier", "more", "--quiet")
    quiet = ecat(*words)
    assert (quiet.code, quiet.out) == (1, "")
    assert "session.json" in quiet.err


def test_references_in_the_texts_of_a_whole_project(ecat: Ecat, project: Path) -> None:
    shutil.rmtree(project / "broken")
    for name in ("a", "b"):
        added(ecat, "object", "add", project / name, "--kind", "other", "--name", "mug")
        added(ecat, "event", "add", project / name, "--span", "1:9", "--text", f"the mug of {name}")
    result = ecat("event", "find-references", project)
    assert (result.code, result.out.splitlines()) == (
        0,
        ["a: 1 change, revision 3", "b: 1 change, revision 3"],
    )
    found = [open_session(project / name).layer().events[0].references for name in ("a", "b")]
    assert [[r.target for r in references] for references in found] == [["o1"], ["o1"]]


def test_other_edits_are_of_one_session(ecat: Ecat, project: Path) -> None:
    assert ecat("event", "remove", project, "a1").code == 1
