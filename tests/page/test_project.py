"""The project as a whole: made, brought in, put away, edited; and what its sessions take from each other."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ecat import formats
from ecat.model import AnnotatedObject, Argument, Event, KeyFrame, Layer, Relation, Segment
from ecat.store import find_sessions, open_project, open_session


def _box(name: str, label: str, *keys: KeyFrame) -> AnnotatedObject:
    return AnnotatedObject(id=name, name=label, kind="rectangle", stream="color", key_frames=keys)


EARLIER = Layer(
    name="main",
    scheme="blocks",
    object_counter=4,
    objects=(
        AnnotatedObject(id="o1", name="body", kind="rig"),
        _box("o2", "cup", KeyFrame(frame=3, coordinates=(10, 20, 30, 40))),
        _box("o3", "lid", KeyFrame(frame=3, coordinates=(10, 10, 30, 10))),
        _box("o4", "spoon", KeyFrame(frame=3, coordinates=(80, 10, 5, 40)), KeyFrame(frame=9, present=False)),
    ),
    relation_counter=1,
    relations=(
        Relation(
            id="r1", predicate="ON", start_frame=5, arguments=(Argument(target="o3"), Argument(target="o2"))
        ),
    ),
)


@pytest.fixture
def study(served: Any, blank_once: Path, window: Callable[..., Any]) -> Generator[tuple[Any, Path]]:
    """A project of its own inside of what is served, with an earlier and a later session; the later one is open."""
    name = f"study {served.path.name[:30]}"
    project = served.server.folder / name
    served.server.ask("/api/project/projects", f'{{"name": "{name}"}}'.encode())
    for session in ("earlier", "later"):
        shutil.copytree(blank_once, project / session)
    with open_session(project / "earlier").write() as commit:
        commit.put_layer(EARLIER)
    ids = {s["name"]: s["id"] for s in _sessions(served, name)}
    # both copies are called what the session was called when it was made
    assert set(ids) == {"slide"}
    later = next(s["id"] for s in _sessions(served, name) if "later" in s["id"])
    made = window(replace(served, path=project / "later"), address=f"#/session/{later}")
    yield made, project
    assert made.complaints == []
    shutil.rmtree(project)


def _sessions(served: Any, project: str) -> list[dict[str, Any]]:
    return [s for s in served.server.ask("/api/project")["sessions"] if s["project"] == project]


def _layer(window: Any, path: Path) -> Layer:
    """What a session's layer is by now, however it is called in addresses."""
    window.page.evaluate("() => window.ecat.api.save(window.ecat.session.id, 'main')")
    return open_session(path).layer("main")


def test_objects_are_copied_from_the_session_before(study: tuple[Any, Path]) -> None:
    window, project = study
    window.at(12)
    window.find("tab-objects").click()
    window.find("copy-objects").click()
    assert window.find("copy-session").input_value() == "earlier"
    assert window.find("copy-o1").is_disabled()
    assert window.find("copy-o4").is_disabled()
    window.find("copy-yes").click()
    window.until("app.document.objects.list.some(o => o.name === 'lid')")
    layer = _layer(window, project / "later")
    copies = {thing.name: thing for thing in layer.objects if thing.name in {"cup", "lid", "spoon"}}
    assert {name: [k.frame for k in thing.key_frames] for name, thing in copies.items()} == {
        "cup": [12],
        "lid": [12],
    }
    facts = {(r.predicate, r.targets, r.start_frame) for r in layer.relations}
    cup, lid = copies["cup"].id, copies["lid"].id
    assert facts == {
        ("IDENTITY", (cup, "earlier/o2"), 12),
        ("IDENTITY", (lid, "earlier/o3"), 12),
        ("ON", (lid, cup), 12),
    }


def test_what_was_gone_at_the_end_is_copied_from_its_last_appearance(study: tuple[Any, Path]) -> None:
    window, project = study
    window.find("tab-objects").click()
    window.find("copy-objects").click()
    window.find("copy-mode").select_option("last_appearance")
    window.find("copy-o2").uncheck()
    window.find("copy-o3").uncheck()
    window.find("copy-yes").click()
    window.until("app.document.objects.list.some(o => o.name === 'spoon')")
    copied = [thing for thing in _layer(window, project / "later").objects if thing.kind == "rectangle"]
    assert [(thing.name, thing.key_frames[0].coordinates) for thing in copied] == [("spoon", (80, 10, 5, 40))]


def test_a_relation_names_an_object_of_another_session(study: tuple[Any, Path]) -> None:
    window, project = study
    window.at(7)
    window.find("tab-relations").click()
    window.find("new-predicate").fill("IDENTITY")
    window.find("new-argument-1").select_option("o2")
    window.find("elsewhere").locator("summary").click()
    window.find("elsewhere-session").select_option("earlier")
    window.page.wait_for_selector('[data-testid="elsewhere-object"] option[value="o2"]', state="attached")
    window.find("elsewhere-object").select_option("o2")
    assert window.find("new-argument-2").input_value() == "earlier/o2"
    window.find("add-relation").click()
    window.until("app.document.relations.list.length === 1")
    (relation,) = _layer(window, project / "later").relations
    assert (relation.predicate, relation.targets, relation.start_frame) == (
        "IDENTITY",
        ("o2", "earlier/o2"),
        7,
    )


@pytest.fixture
def listed(served: Any, window: Callable[..., Any]) -> Generator[Any]:
    """The list of sessions of the whole folder."""
    made = window(served)
    made.page.evaluate("() => { location.hash = '#/'; }")
    made.page.wait_for_selector('[data-testid="statistics"]')
    yield made
    assert made.complaints == []


def test_a_project_is_made_and_listed(served: Any, listed: Any) -> None:
    name = f"pilot {served.path.name[:20]}"
    listed.find("new-project").click()
    listed.find("new-name").fill("../up")
    assert listed.find("new-project-yes").is_disabled()
    listed.find("new-name").fill(name)
    listed.find("new-project-yes").click()
    listed.find(f"project-{name}").wait_for()
    assert open_project(served.server.folder / name).manifest.name == name
    (served.server.folder / name / "project.json").unlink()
    (served.server.folder / name).rmdir()


@pytest.fixture
def old(served: Any, tmp_path: Path) -> Path:
    """A session folder of ECAT 2018."""
    dest = tmp_path / "Old 1"
    formats.export(served.path, dest, format="ecat-2018")
    return dest


def test_a_recording_is_imported_from_the_browsers_own_machine(served: Any, listed: Any, old: Path) -> None:
    name = f"came-{served.path.name[:20]}"
    listed.find("import-recording").click()
    listed.find("import-folder").set_input_files(str(old))
    assert listed.find("new-name").input_value() == "Old 1"
    listed.find("new-name").fill(name)
    listed.find("import-yes").click()
    listed.find(f"session-{name}").wait_for(timeout=30_000)
    made = open_session(served.server.folder / name)
    assert made.manifest.provenance.format == "ecat-2018"
    assert {thing.name for thing in made.layer("main").objects} >= {"Shell", "Stella Artois"}
    shutil.rmtree(served.server.folder / name)


def test_a_recording_that_cannot_be_read_says_why_and_leaves_nothing(
    served: Any, listed: Any, tmp_path: Path
) -> None:
    (tmp_path / "notes.txt").write_text("buy milk")
    before = find_sessions(served.server.folder)
    listed.find("import-recording").click()
    listed.find("import-file").set_input_files(str(tmp_path / "notes.txt"))
    listed.find("import-yes").click()
    listed.find("toasts").get_by_text("it looks like none of the formats").wait_for()
    assert find_sessions(served.server.folder) == before


def test_a_session_is_archived_brought_back_and_deleted(served: Any, listed: Any) -> None:
    name = served.path.name
    listed.find(f"archive-{name}").click()
    listed.find("question-yes").click()
    listed.find(f"session-{name}").wait_for(state="detached")
    assert not served.path.exists()
    listed.find("archive").locator("summary").click()
    listed.find(f"restore-{name}").click()
    listed.find(f"session-{name}").wait_for()
    assert served.session().layer("main").objects

    listed.find(f"delete-{name}").click()
    listed.find("confirm-name").fill(name)
    assert listed.find("confirm-yes").is_disabled(), "its name is what it calls itself"
    listed.find("confirm-name").fill("slide")
    listed.find("confirm-yes").click()
    listed.find(f"session-{name}").wait_for(state="detached")
    assert not served.path.exists()
    assert not (served.server.folder / ".archive").exists()


def test_a_session_that_somebody_edits_stays(served: Any, listed: Any, window: Callable[..., Any]) -> None:
    ben = window(served, author="ben")
    ben.press("e")  # their window may not have told its name yet
    listed.find(f"archive-{served.path.name}").click()
    listed.find("question-yes").click()
    listed.find("toasts").get_by_text("still in it").wait_for()
    assert len(served.layer().events) == 1


def test_windows_are_laid_over_all_sessions(served: Any, listed: Any, blank_once: Path) -> None:
    other = served.server.folder / f"{served.path.name}-other"
    shutil.copytree(blank_once, other)
    try:
        listed.find("refresh").click()
        listed.find(f"session-{other.name}").wait_for()
        listed.find("windows-everywhere").click()
        assert listed.find("windows-existing").input_value() == "skip"
        for field, value in {"step": "60", "duration": "60", "tier": "window", "layer": "windows"}.items():
            listed.find(f"windows-{field}").fill(value)
        listed.find("windows-yes").click()
        listed.find("toasts").get_by_text("sessions were edited").wait_for(timeout=60_000)
        n = (served.session().manifest.n_frames - 60) // 60 + 1
        for path in (served.path, other):
            events = open_session(path).layer("windows").events
            assert [(e.tier, e.segments[0].end_frame - e.segments[0].start_frame) for e in events] == [
                ("window", 60)
            ] * n
    finally:
        shutil.rmtree(other)


def test_all_sessions_are_edited_in_the_layer_to_begin_with(served: Any, annotating: Any) -> None:
    annotating.new_layer("ben")
    annotating.page.evaluate("() => { location.hash = '#/'; }")
    for button, field in (("windows-everywhere", "windows-layer"), ("find-everywhere", "prompt-input")):
        annotating.find(button).click()
        assert annotating.find(field).input_value() == "main"
        annotating.page.keyboard.press("Escape")
        annotating.page.wait_for_selector("dialog", state="detached")


def test_objects_are_found_in_the_texts_of_all_sessions(served: Any, listed: Any) -> None:
    session = served.session()
    told = Event(id="a1", text="Shell passes", segments=(Segment(start_frame=1, end_frame=5),))
    with session.write() as commit:
        commit.put_layer(replace(session.layer("main"), events=(told,), event_counter=1))
    listed.find("find-everywhere").click()
    listed.find("prompt-yes").click()
    listed.find("toasts").get_by_text("sessions were edited").wait_for(timeout=60_000)
    (event,) = served.layer().events
    assert [(r.start, r.end, r.target) for r in event.references] == [(0, 5, "o2")]


def test_the_project_says_how_much_is_in_it(served: Any, listed: Any) -> None:
    # as the list was told: sessions of other tests are still being written
    sessions = listed.says("app.project.sessions")
    assert {served.path.name} <= {s["id"] for s in sessions}
    text = listed.find("statistics").inner_text()
    assert f"{len(sessions)} sessions" in text
    assert f"{sum(s['n_objects'] for s in sessions)} objects" in text
