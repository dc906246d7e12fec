"""Which layers are compared: of one session, or of the same session annotated twice."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ecat.annotate.agreement import agree, figures, reasons
from ecat.cli import main
from ecat.errors import NotFoundError, UsageError
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Manifest, Relation, Segment
from ecat.model.annotation import Argument
from ecat.store import Draft, create_session


def layer(name: str, start: int, thing: str = "o1", other: str = "") -> Layer:
    segments = (Segment(start_frame=start, end_frame=start + 20),)
    keys = (KeyFrame(frame=0, coordinates=(10.0, 10.0, 50.0, 50.0)),)
    identity = Relation(
        predicate="IDENTITY", start_frame=0, arguments=(Argument(target=thing), Argument(target=other))
    )
    return Layer(
        name=name,
        objects=(AnnotatedObject(id=thing, name="mug", kind="rectangle", key_frames=keys),),
        events=(Event(id="e1", type="slide", tier="event", segments=segments),),
        relations=(identity,) if other else (),
    )


def session(path: Path, *layers: Layer) -> Path:
    path.parent.mkdir(exist_ok=True)
    manifest = Manifest(name=path.name, created="2026-01-01T00:00:00Z", n_frames=60)
    create_session(path, Draft(manifest=manifest, layers=layers))
    return path


def test_layers_of_one_session_are_compared(tmp_path: Path) -> None:
    path = session(tmp_path / "s", layer("ann", 10), layer("ben", 12), layer("machine", 30))
    found = agree([path])
    assert found.agreement.raters == ("ann", "ben"), "what the machine proposes is nobody's opinion"
    assert agree([path], ["ann", "machine"]).agreement.raters == ("ann", "machine")


def test_the_same_session_in_two_projects(tmp_path: Path) -> None:
    for who, start, thing in (("ann", 10, "o1"), ("ben", 11, "o5")):
        session(tmp_path / who / "clip1", layer("main", start, thing))
        session(tmp_path / who / "clip2", layer("main", start, "o9", f"clip1/{thing}"))
    session(tmp_path / "ben" / "clip3", layer("main", 0))
    found = agree([tmp_path / "ann", tmp_path / "ben"])
    assert found.agreement.raters == ("ann", "ben")
    assert (found.agreement.sessions, found.agreement.frames) == (2, 120)
    assert list(reasons(found.left_out)) == [("not in all of them", 1)]
    # the object of another session that both mean has another id in each project
    assert figures(found.agreement)["relations"]["IDENTITY"]["f1"] == 1.0


def test_two_single_sessions_may_have_any_name(tmp_path: Path) -> None:
    first = session(tmp_path / "a", layer("main", 10))
    second = session(tmp_path / "b", layer("main", 10))
    assert agree([first, second]).agreement.sessions == 1


def test_one_annotator_agrees_with_nobody(tmp_path: Path) -> None:
    path = session(tmp_path / "s", layer("main", 10))
    with pytest.raises(UsageError, match="one annotator"):
        agree([path])
    with pytest.raises(UsageError, match="cannot compare"):
        agree([path, path, path], ["a", "b"])


def test_projects_without_a_common_session_say_so(tmp_path: Path) -> None:
    session(tmp_path / "ann" / "clip1", layer("main", 10))
    session(tmp_path / "ann" / "clip2", layer("main", 10))
    session(tmp_path / "ben" / "clip3", layer("main", 10))
    with pytest.raises(NotFoundError, match="no session"):
        agree([tmp_path / "ann", tmp_path / "ben"])


def test_a_damaged_layer_is_left_out_with_its_reason(tmp_path: Path) -> None:
    for who in ("ann", "ben"):
        for clip in ("clip1", "clip2"):
            session(tmp_path / who / clip, layer("main", 10))
    (tmp_path / "ben" / "clip2" / "annotations" / "main.xml").write_text("<layer")
    found = agree([tmp_path / "ann", tmp_path / "ben"])
    assert found.agreement.sessions == 1
    assert [name for name, _ in found.left_out] == ["clip2"]


def test_the_verb_prints_a_page_or_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = session(tmp_path / "s", layer("ann", 10), layer("ben", 12))
    assert main(["agree", str(path)]) == 0
    page = capsys.readouterr().out
    assert "ann and ben: 1 session, 60 frames" in page
    assert "type slide" in page
    assert main(["agree", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["events"][0]["f1"] == 1.0


def test_the_verb_reads_ratings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "answers.csv"
    table.write_text("item,rater,answer,truth\n1,a,x,x\n1,b,x,x\n2,a,x,y\n2,b,y,y\n")
    assert main(["agree", str(table)]) == 0
    assert "right: 75.0%" in capsys.readouterr().out


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"a,b\n1,2\n"])
def test_a_table_of_something_else_is_an_error_of_four_lines(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "answers.csv"
    table.write_bytes(content)
    assert main(["agree", str(table)]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 4


def test_two_people_on_the_same_film_clips(shared: Path, tmp_path: Path) -> None:
    annotation = shared / "ecat_movies" / "Annotation_Test"
    for who in ("Bao", "Son"):
        source = annotation / who / "Forrest_Gump"
        assert main(["import", "--quiet", str(source), str(tmp_path / who)]) == 0
    found = agree([tmp_path / "Bao", tmp_path / "Son"])
    assert found.agreement.sessions == 10
    objects = figures(found.agreement)["objects"]
    assert 0.2 < objects["f1"] < 0.9
    assert objects["mean_iou"] > 0.6
