"""Annotations become a layer of a session that is there, a session of their own, or a project."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from ecat.annotate import Editor, operations_from_list
from ecat.check import check
from ecat.cli import main
from ecat.errors import ExistsError, FormatError, LimitError, NotFoundError, UsageError
from ecat.formats import export, import_layer, import_source, registry
from ecat.formats.interchange import making, reading
from ecat.model import Layer
from ecat.sample import sample_session
from ecat.store import Session, create_session, find_sessions, open_session, validate
from tests.formats.interchange.documents import written
from tests.formats.interchange.layers import base_session

FORMATS = ("boris", "coco", "csv", "cvat-video", "elan", "epic-kitchens", "label-studio", "via", "vidat")


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    return written(tmp_path / "files")


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return base_session(tmp_path, "uniform", file="media/take.mp4")


def video(path: Path, n: int = 45) -> None:
    """A small video of a second and a half."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("h264", rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(n):
            image = np.full((48, 64, 3), 5 * i, np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        out.mux(stream.encode(None))


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_is_known_by_its_look(name: str, files: dict[str, Path]) -> None:
    assert registry.sniff(files[name]).name == name


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_exported_is_known_by_its_look(name: str, tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    create_session(tmp_path / "s", draft)
    dest = tmp_path / f"out{registry.find(name).suffix}"
    export(tmp_path / "s", dest, format=name)
    assert registry.sniff(dest).name == name


class TestALayerOfASessionThatIsThere:
    """Nothing that is there is touched, and the history of the layer is right."""

    @pytest.mark.parametrize("name", FORMATS)
    def test_a_layer_is_added(self, name: str, files: dict[str, Path], session: Session) -> None:
        if name == "epic-kitchens":
            files[name].write_text(files[name].read_text().replace("P01_01,", "s,"))
        report = import_layer(files[name], session.path, layer="ann")
        again = open_session(session.path)
        assert (report.format, report.path) == (name, session.path)
        assert [record.name for record in again.manifest.layers] == ["ann", "main"]
        layer = again.layer("ann")
        assert layer.events or layer.objects
        assert again.layer("main") == Layer()
        assert validate(again, deep=True) == []
        assert [f for f in check(again.path) if f.severity == "error"] == []

    def test_a_layer_that_is_there_is_never_replaced(self, files: dict[str, Path], session: Session) -> None:
        before = (session.path / "session.json").read_bytes()
        with pytest.raises(ExistsError, match="there is a layer main already"):
            import_layer(files["elan"], session.path, layer="main")
        assert (session.path / "session.json").read_bytes() == before

    def test_it_can_be_edited_and_its_history_begins_with_it(
        self, files: dict[str, Path], session: Session
    ) -> None:
        import_layer(files["elan"], session.path, layer="ann")
        before = open_session(session.path).layer("ann")
        editor = Editor(open_session(session.path), layer="ann", author="bo")
        editor.apply(operations_from_list([{"op": "edit_event", "id": "a1", "text": "new"}]))
        editor.undo()
        editor.save()
        after = open_session(session.path).layer("ann")
        assert {e.id: e.text for e in after.events} == {e.id: e.text for e in before.events}
        editor.apply(operations_from_list([{"op": "add_event", "segments": [[1, 2]]}]))
        assert editor.layer.events[-1].id == "a7"

    def test_objects_that_the_session_has_are_the_same(self, tmp_path: Path) -> None:
        draft, _ = sample_session(seed=1, actions=("next",))
        made = create_session(tmp_path / "s", draft)
        export(made.path, tmp_path / "a.eaf", format="elan")
        import_layer(tmp_path / "a.eaf", made.path, layer="ann")
        mine = {thing.id: thing for thing in draft.layers[0].objects}
        for thing in open_session(made.path).layer("ann").objects:
            assert (thing.name, thing.kind, thing.origin) == (
                mine[thing.id].name, mine[thing.id].kind, mine[thing.id].origin,
            )  # fmt: skip

    def test_a_file_about_other_recordings_is_refused(self, files: dict[str, Path], tmp_path: Path) -> None:
        other = base_session(tmp_path / "other", "uniform", file="media/other.mp4")
        with pytest.raises(FormatError, match="it is about take, live, and none of them is s"):
            import_layer(files["boris"], other.path, layer="ann")
        assert [record.name for record in open_session(other.path).manifest.layers] == ["main"]

    @pytest.mark.parametrize("layer", ["", "a/b", "machine", "x.scheme"])
    def test_a_layer_has_a_name_of_its_own(
        self, layer: str, files: dict[str, Path], session: Session
    ) -> None:
        with pytest.raises(UsageError, match="layer"):
            import_layer(files["elan"], session.path, layer=layer)

    def test_a_recording_is_no_layer(self, session: Session, tmp_path: Path) -> None:
        video(tmp_path / "a.mp4", 2)
        with pytest.raises(UsageError, match="video holds no annotations"):
            import_layer(tmp_path / "a.mp4", session.path, layer="ann")

    def test_there_has_to_be_a_session(self, files: dict[str, Path], tmp_path: Path) -> None:
        with pytest.raises(NotFoundError):
            import_layer(files["elan"], tmp_path / "nothing", layer="ann")

    def test_more_than_anybody_annotates_is_refused(
        self, files: dict[str, Path], session: Session, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(making, "MOST_EVENTS", 3)
        with pytest.raises(LimitError, match="more than 3 events"):
            import_layer(files["elan"], session.path, layer="ann")


class TestANewSession:
    """The video beside the file comes along; without one, the clock is what the file says."""

    @pytest.mark.parametrize(
        "name", [name for name in FORMATS if name not in {"boris", "csv", "epic-kitchens"}]
    )
    def test_the_video_beside_the_file_comes_along(
        self, name: str, files: dict[str, Path], tmp_path: Path
    ) -> None:
        if name == "coco":
            said = json.loads(files[name].read_text())
            said["videos"][0]["file_name"] = "take.mp4"
            files[name].write_text(json.dumps(said))
        video(files[name].parent / "take.mp4")
        report = import_source(files[name], tmp_path / "new")
        made = open_session(tmp_path / "new")
        assert (report.format, made.name, made.manifest.provenance.format) == (name, "new", name)
        assert made.manifest.n_frames == 45
        assert made.stream("color").present
        assert made.layer("main").events or made.layer("main").objects
        assert validate(made, deep=True) == []
        assert {p.name for p in (tmp_path / "new").iterdir()} <= {
            "session.json", "media", "tables", "annotations",
        }  # fmt: skip

    @pytest.mark.parametrize("name", [name for name in FORMATS if name != "boris"])
    def test_without_a_video_there_is_a_session_all_the_same(
        self, name: str, files: dict[str, Path], tmp_path: Path
    ) -> None:
        report = import_source(files[name], tmp_path / "new")
        made = open_session(tmp_path / "new")
        assert "the session has no media" in report.findings[-1]
        assert made.manifest.provenance.notes == report.findings
        assert [f for f in check(made.path) if f.severity == "error"] == []
        known = {"elan", "csv", "epic-kitchens", "via", "vidat", "label-studio"}
        assert (made.manifest.clock.rule == "uniform") == (name in known)

    def test_a_vocabulary_becomes_the_coding_scheme(self, files: dict[str, Path], tmp_path: Path) -> None:
        import_source(files["elan"], tmp_path / "new")
        made = open_session(tmp_path / "new")
        assert made.layer().scheme == "a"
        assert made.path.joinpath("annotations", "a.scheme.xml").is_file()
        assert [f for f in check(made.path) if f.severity != "note"] == []

    def test_a_project_of_several_recordings(self, files: dict[str, Path], tmp_path: Path) -> None:
        report = import_source(files["boris"], tmp_path / "project")
        assert report.sessions == 2
        assert [path.name for path in find_sessions(tmp_path / "project")] == ["live", "take"]
        assert len(open_session(tmp_path / "project" / "take").layer().events) == 4

    def test_more_recordings_than_anybody_has_are_refused(
        self, files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(reading, "MOST_RECORDINGS", 1)
        with pytest.raises(LimitError, match="it is about 2 recordings"):
            import_source(files["boris"], tmp_path / "project")
        assert not (tmp_path / "project").exists()

    def test_nothing_is_left_where_the_file_cannot_be_read(
        self, files: dict[str, Path], tmp_path: Path
    ) -> None:
        files["elan"].write_text(files["elan"].read_text().replace('"3000"', '"x"'))
        video(files["elan"].parent / "take.mp4", 2)
        before = sorted(tmp_path.iterdir())
        with pytest.raises(FormatError):
            import_source(files["elan"], tmp_path / "new")
        assert sorted(tmp_path.iterdir()) == before

    def test_nothing_is_left_where_the_video_cannot_be_read(
        self, files: dict[str, Path], tmp_path: Path
    ) -> None:
        (files["elan"].parent / "take.mp4").write_bytes(b"no video")
        before = sorted(tmp_path.iterdir())
        with pytest.raises(FormatError):
            import_source(files["elan"], tmp_path / "new")
        assert sorted(tmp_path.iterdir()) == before

    @pytest.mark.parametrize(
        "name", ["../take.mp4", "/etc/passwd", "x" * 5000 + ".mp4", "a\x7f.mp4", "%2e%2e/take.mp4"]
    )
    def test_media_elsewhere_are_not_looked_for(
        self, name: str, files: dict[str, Path], tmp_path: Path
    ) -> None:
        video(files["elan"].parent.parent / "take.mp4", 2)
        text = (
            files["elan"]
            .read_text()
            .replace("./take.mp4", name)
            .replace("file:///C:/Users/ann/take.mp4", name)
        )
        files["elan"].write_text(text)
        import_source(files["elan"], tmp_path / "new")
        assert (
            not open_session(tmp_path / "new")
            .stream(open_session(tmp_path / "new").manifest.streams[0].name)
            .present
        )


class TestTheCommandLine:
    """`ecat export my_session a.eaf`, and back."""

    @pytest.fixture
    def made(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        draft, _ = sample_session(seed=1, actions=("next",))
        create_session(tmp_path / "my_session", draft)
        monkeypatch.chdir(tmp_path)
        return tmp_path

    def test_there_and_back(self, made: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["export", "my_session", "a.eaf", "--format", "elan"]) == 0
        assert "ELAN has no place for" in capsys.readouterr().out
        assert main(["import", "a.eaf", "my_session", "--layer", "ann"]) == 0
        assert "imported 1 session (elan) to my_session" in capsys.readouterr().out
        assert main(["import", "a.eaf", "new_session"]) == 0
        assert "the session has no media" in capsys.readouterr().out
        first, second = (open_session(made / "my_session").layer(name) for name in ("main", "ann"))
        assert sorted(e.id for e in first.events) == sorted(e.id for e in second.events)

    def test_a_session_that_is_there_needs_the_name_of_a_layer(
        self, made: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        main(["export", "my_session", "a.eaf", "--format", "elan"])
        assert main(["import", "a.eaf", "my_session"]) == 1
        assert "--layer NAME" in capsys.readouterr().err
        assert main(["import", "a.eaf", "my_session", "--layer", "main"]) == 1
        assert "there is a layer main already" in capsys.readouterr().err

    def test_the_layer_to_write_may_be_named(self, made: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["export", "my_session", "a.csv", "--format", "csv", "--option", "layer=nobody"]) == 1
        assert "its layers are: main" in capsys.readouterr().err
