"""What comes into an open session: 3-D of drawn shapes, skeletons of a file, layers that other programs wrote."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ecat import formats
from ecat.model import AnnotatedObject, Event, Layer, Segment
from ecat.process import process_session
from ecat.store import open_session
from ecat.store.lock import locked

RECORDING = Path(__file__).resolve().parents[2] / "sample_sessions" / "recorded" / "slide_toward"


def _draw(window: Any, name: str, frame: int, coordinates: list[float]) -> str:
    said = {"op": "add_object", "kind": "polygon", "name": name, "frame": frame, "coordinates": coordinates}
    return str(
        window.page.evaluate(
            "async (said) => (await window.ecat.edit(said)).changes.find(c => c.kind === 'object').id", said
        )
    )


# --- 3-D


@pytest.fixture(scope="session")
def recorded_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of colour and depth."""
    folder = tmp_path_factory.mktemp("recorded") / "recorded"
    formats.import_source(RECORDING, folder)
    return folder


@pytest.fixture
def recorded(served: Any, recorded_once: Path, window: Callable[..., Any]) -> Generator[tuple[Any, Any]]:
    """A copy of it, opened."""
    path = shutil.copytree(recorded_once, served.path.with_name(f"{served.path.name}-recorded"))
    copy = replace(served, path=path)
    made = window(copy)
    yield made, copy
    assert made.complaints == []


def test_a_drawn_shape_gets_its_hull(recorded: tuple[Any, Any]) -> None:
    window, copy = recorded
    window.at(90)
    head = _draw(window, "head", 90, [460, 100, 530, 70, 560, 130, 540, 240, 470, 240])
    window.page.evaluate("(id) => window.ecat.select([{ kind: 'object', id, layer: 'main' }])", head)
    assert "No hull" in window.find("hull").inner_text()
    window.find("generate-3d").click()
    window.find("job").get_by_text("Generating 3-D").wait_for()
    window.page.wait_for_function(
        "() => document.querySelector('[data-testid=hull]')?.textContent.includes('corners')", timeout=60_000
    )
    hulls = copy.session().table("hulls").to_arrow().to_pylist()
    assert {row["object_id"] for row in hulls} == {head}
    said = f"Hull of {sum(row['frame'] == 90 for row in hulls)} corners"
    window.find("hull").get_by_text(said).wait_for()
    # what is known stays in view while it is fetched again
    again = "() => new Promise((shown) => { window.ecat.emitTables(); requestAnimationFrame(shown); })"
    window.page.evaluate(again)
    assert said in window.find("hull").inner_text()
    window.page.wait_for_function(
        "() => document.querySelector('[data-testid=space-text]').textContent.includes('head: hull')"
    )


def test_where_there_is_no_depth_no_hull_is_offered(annotating: Any) -> None:
    shape = _draw(annotating, "cup", 3, [10, 10, 60, 10, 60, 60])
    annotating.page.evaluate("(id) => window.ecat.select([{ kind: 'object', id, layer: 'main' }])", shape)
    annotating.find("object-name").wait_for()
    assert annotating.find("generate-3d").count() == 0


# --- files


def test_the_skeletons_of_a_file_are_added(served: Any, annotating: Any, tmp_path: Path) -> None:
    formats.export(served.path, tmp_path / "old", format="ecat-2018")
    (rig,) = (tmp_path / "old").glob("rig*.xml")
    before = served.session().table("joints").to_arrow().num_rows
    annotating.find("session-button").click()
    annotating.find("add-skeleton").click()
    annotating.find("skeleton-files").set_input_files(str(rig))
    annotating.find("skeleton-yes").click()
    annotating.until("app.document.objects.list.filter(o => o.kind === 'rig').length === 2")
    annotating.until("app.session.bodies.length === 2")
    added = served.layer().objects[-1]
    rows = served.session().table("joints").to_arrow()
    mine = [row for row in rows.to_pylist() if row["object_id"] == added.id]
    assert rows.num_rows == before + len(mine)
    assert (added.kind, added.semantic_type, added.name) == ("rig", "bodyRig", rig.stem)
    assert any(s.kind == "skeleton" and s.present for s in served.session().manifest.streams)
    annotating.until(f"app.selectedObject?.id === '{added.id}'")


def test_the_session_says_what_it_is_made_of_and_what_was_said(annotating: Any) -> None:
    annotating.press("e")
    annotating.find("segment-0-end").fill("0")
    annotating.find("segment-0-end").press("Enter")
    annotating.find("toasts").get_by_text("cannot").first.wait_for()
    annotating.find("session-button").click()
    assert "joints" in annotating.find("session-tables").inner_text()
    said = annotating.find("messages").inner_text().split("\n")
    assert "cannot move edge" in said[0]
    assert "nothing was changed" in said
    annotating.find("upper-body").check()
    assert annotating.says("app.settings.body") == "upper"
    annotating.find("show-marks").uncheck()
    assert annotating.says("app.settings.marks") is False


# --- other programs


def _machine(path: Path, *events: Event) -> None:
    session = open_session(path)
    objects = (AnnotatedObject(id="o2", name="Shell", kind="marker_box"),)
    with session.write() as commit:
        commit.put_layer(Layer(name="machine", objects=objects, events=events))


def _event(name: str, start: int, end: int) -> Event:
    segments = (Segment(start_frame=start, end_frame=end),)
    return Event(id=name, type="slide_next", status="proposed", segments=segments)


def test_a_layer_that_another_program_replaced_is_shown_as_it_is_now(
    served: Any, window: Callable[..., Any]
) -> None:
    _machine(served.path, _event("a1", 10, 30))
    page = window(served)
    assert page.says("app.machine.events.list.map(e => e.id)") == ["a1"]
    page.find("tab-machine").click()
    _machine(served.path, _event("a5", 40, 60), _event("a6", 70, 90))
    page.until("app.machine.events.list.map(e => e.id).join() === 'a5,a6'")
    page.find("row-a6").wait_for()
    assert page.complaints == []


def test_a_layer_with_a_history_that_was_replaced_says_so(served: Any, annotating: Any) -> None:
    annotating.press("e")
    served.layer()
    session = open_session(served.path)
    with session.write() as commit:
        commit.put_layer(replace(session.layer("main"), events=(_event("a9", 5, 9),)))
    annotating.until("app.document.events.list.map(e => e.id).join() === 'a9'")
    annotating.find("toasts").get_by_text("Another program replaced the layer main").wait_for()


def test_tables_that_a_stage_made_meanwhile_are_shown(served: Any, annotating: Any) -> None:
    assert "poses" not in annotating.says("app.session.tables")
    process_session(served.path, stages=["plane", "pose"])
    annotating.until("app.session.tables.includes('poses')")
    annotating.page.wait_for_function(
        "() => document.querySelector('[data-testid=space-text]').textContent.includes('Shell at')"
    )


def test_tables_that_were_made_before_the_page_could_be_told_are_shown(
    served: Any, window: Callable[..., Any]
) -> None:
    ann, ben = window(served), window(served, author="ben")
    lines: list[Any] = []
    ann.page.route_web_socket("**/live", lambda line: lines.append(line))  # noqa: PLW0108
    ann.page.reload()
    ann.opened()
    process_session(served.path, stages=["plane", "pose"])
    ben.until("app.session.tables.includes('poses')")
    assert "poses" not in ann.says("app.session.tables")
    lines[0].connect_to_server()
    ann.until("app.session.tables.includes('poses')")
    assert ann.complaints == ben.complaints == []


def test_descriptions_that_come_late_take_nothing_back(annotating: Any) -> None:
    tables = annotating.page.evaluate("""async () => {
        const { api } = ecat, { session } = api;
        let asked = 0;
        api.session = async (...which) => {
            const nth = ++asked, answer = await session(...which);
            if (nth > 1) return answer;
            await new Promise((resolve) => setTimeout(resolve, 300));
            return { ...answer, tables: ['of before'] };
        };
        await Promise.all([ecat.refreshSession(), ecat.refreshSession()]);
        api.session = session;
        return ecat.session.tables;
    }""")
    assert "of before" not in tables


def test_a_layer_that_comes_late_takes_no_edit_back(annotating: Any) -> None:
    annotating.page.evaluate("""() => {
        const { api } = ecat, { layer } = api;
        api.layer = async (...which) => {
            const answer = await layer(...which);
            window.old = answer.revision;
            while (ecat.active.revision === answer.revision) await new Promise(requestAnimationFrame);
            api.layer = layer;
            setTimeout(() => (window.came = true), 50);
            return answer;
        };
        ecat.onLive({ type: 'replaced', layer: 'main', revision: 0 });
    }""")
    annotating.until("window.old === 0")
    annotating.press("e")
    annotating.until("window.came")
    assert annotating.says("app.document.events.list.length") == 1


def test_what_the_server_cannot_write_is_told_and_is_written_later(served: Any, annotating: Any) -> None:
    # the first edit begins the journal, which needs the lock
    annotating.press("e")
    served.layer()
    with locked(served.path, wait_s=10):
        annotating.press("u")
        annotating.find("toasts").get_by_text("The layer main could not be written").wait_for(timeout=30_000)
    assert [event.unsure for event in served.layer().events] == [True]


def test_other_files_are_kept_with_the_session_and_removed(
    served: Any, annotating: Any, tmp_path: Path
) -> None:
    (tmp_path / "consent form.pdf").write_bytes(b"%PDF")
    before = served.session().manifest.streams
    annotating.find("session-button").click()
    annotating.find("add-file").click()
    annotating.find("file-files").set_input_files(str(tmp_path / "consent form.pdf"))
    annotating.find("file-yes").click()
    annotating.find("file-consent form.pdf").wait_for()
    kept = served.session().stream_path("consent form.pdf")
    assert kept.read_bytes() == b"%PDF"
    link = annotating.find("file-consent form.pdf").get_by_role("link", name="Save a copy")
    with annotating.page.expect_download() as download:
        link.click()
    assert download.value.suggested_filename == "consent form.pdf"
    annotating.find("remove-file-consent form.pdf").click()
    annotating.find("question-yes").click()
    annotating.find("file-consent form.pdf").wait_for(state="detached")
    assert not kept.exists()
    assert served.session().manifest.streams == before


def test_the_stages_are_run_from_the_page(served: Any, annotating: Any) -> None:
    annotating.find("session-button").click()
    annotating.find("process").click()
    annotating.find("toasts").get_by_text("Done:").wait_for(timeout=90_000)
    assert "poses" in annotating.find("session-tables").inner_text()
    assert {"table_plane", "poses"} <= set(served.session().tables)
    annotating.find("process").click()
    annotating.find("toasts").get_by_text("Everything was up to date").wait_for(timeout=30_000)
