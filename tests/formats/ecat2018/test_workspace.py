"""Sessions, projects and workspaces as folders, there and back, or an error and nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ecat.errors import EcatError, ExistsError, FormatError, NotFoundError
from ecat.formats import export, import_source
from ecat.formats.ecat2018.workspace import sniff, tree_of
from ecat.store import find_sessions, open_project, open_session
from tests.formats.ecat2018.documents import document, event, save

GOOD = document(events=event())
BAD = document(events=event()).replace('startFrame="1"', 'startFrame="x"')


def workspace(root: Path, *sessions: str, bad: str = "", text: str = GOOD) -> Path:
    """A folder with these sessions (``project/session``)."""
    for name in sessions:
        path = root / name / "files.param"
        path.parent.mkdir(parents=True)
        path.write_bytes((BAD if name == bad else text).encode())
    return root


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def refusal(source: Path, dest: Path, *, keep_going: bool = False) -> EcatError:
    """The one error of an import that leaves nothing."""
    before = sorted(dest.parent.rglob("*"))
    with pytest.raises(EcatError) as caught:
        import_source(source, dest, format="ecat-2018", keep_going=keep_going)
    assert sorted(dest.parent.rglob("*")) == before, "nothing is left, no staging folder either"
    return caught.value


class TestTree:
    def test_a_folder_with_the_session_file_is_a_session(self, tmp_path: Path) -> None:
        found = tree_of(workspace(tmp_path, "S1") / "S1")
        assert found is not None
        assert found.kind == "session"

    def test_a_folder_of_sessions_is_a_project_and_its_other_folders_are_empty_sessions(
        self, tmp_path: Path
    ) -> None:
        (workspace(tmp_path, "P/S1") / "P" / "S2").mkdir()
        found = tree_of(tmp_path / "P")
        assert found is not None
        assert (found.kind, [(c.path.name, c.kind) for c in found.children]) == (
            "project",
            [("S1", "session"), ("S2", "session")],
        )

    def test_a_folder_of_projects_is_a_workspace(self, tmp_path: Path) -> None:
        found = tree_of(workspace(tmp_path / "w", "P/S1", "Q/S1", "Q/S2"))
        assert found is not None
        assert (found.kind, len(list(found.sessions()))) == ("workspace", 3)

    def test_hidden_folders_and_links_that_leave_are_not_followed(self, tmp_path: Path) -> None:
        workspace(tmp_path / "w", "P/S1", "P/.git")
        workspace(tmp_path / "elsewhere", "S9")
        (tmp_path / "w" / "P" / "S9").symlink_to(tmp_path / "elsewhere" / "S9")
        found = tree_of(tmp_path / "w")
        assert found is not None
        assert [node.path.name for node in found.sessions()] == ["S1"]

    def test_a_link_to_itself_ends(self, tmp_path: Path) -> None:
        workspace(tmp_path / "w", "P/S1")
        (tmp_path / "w" / "P" / "loop").symlink_to(tmp_path / "w")
        found = tree_of(tmp_path / "w")
        assert found is not None
        assert len(list(found.sessions())) < 20

    def test_other_folders_are_nothing(self, tmp_path: Path) -> None:
        assert tree_of(tmp_path) is None


class TestSniff:
    def test_a_session_file_and_any_folder_above_it(self, tmp_path: Path) -> None:
        workspace(tmp_path / "w", "P/S1")
        assert all(sniff(tmp_path / "w" / name) for name in (".", "P", "P/S1", "P/S1/files.param"))

    def test_nothing_else(self, tmp_path: Path) -> None:
        (tmp_path / "a.xml").write_text("<session/>")
        assert not sniff(tmp_path)
        assert not sniff(tmp_path / "a.xml")


class TestRoundTrip:
    @pytest.mark.parametrize("sessions", [("S1",), ("P/S1", "P/S2"), ("A/P/S1", "A/Q/S1", "B/S1")])
    def test_any_nesting_comes_back(self, tmp_path: Path, sessions: tuple[str, ...]) -> None:
        source = workspace(tmp_path / "w", *sessions)
        report = import_source(source, tmp_path / "made")
        assert report.sessions == len(sessions) == len(find_sessions(tmp_path / "made"))
        assert export(tmp_path / "made", tmp_path / "back", format="ecat-2018").sessions == len(sessions)
        assert contents(tmp_path / "back") == contents(source)

    def test_one_session_by_its_file(self, tmp_path: Path) -> None:
        workspace(tmp_path, "S1")
        import_source(tmp_path / "S1" / "files.param", tmp_path / "made")
        assert open_session(tmp_path / "made").name == "S1"

    @pytest.mark.parametrize("listed", [b"S1\r\nS2\r\n", b"S1\nS1\ngone\n", b"S1", b""])
    def test_the_list_of_a_project_comes_back_stale_as_it_may_be(self, tmp_path: Path, listed: bytes) -> None:
        source = workspace(tmp_path / "w", "P/S1", "P/S2")
        (source / "P" / "P.project").write_bytes(listed)
        import_source(source, tmp_path / "made")
        export(tmp_path / "made", tmp_path / "back", format="ecat-2018")
        assert contents(tmp_path / "back") == contents(source)

    def test_kinds_are_those_of_the_source(self, tmp_path: Path) -> None:
        import_source(workspace(tmp_path / "w", "P/S1"), tmp_path / "made")
        assert open_project(tmp_path / "made").manifest.kind == "workspace"
        assert open_project(tmp_path / "made" / "P").manifest.kind == "project"

    def test_files_beside_sessions_are_told(self, tmp_path: Path) -> None:
        source = workspace(tmp_path / "w", "P/S1")
        (source / "P" / "notes.txt").write_text("x")
        report = import_source(source, tmp_path / "made")
        assert report.findings == ("P/notes.txt belongs to no session; not imported",)

    def test_a_file_called_project_json_in_a_session_is_its_own_affair(self, tmp_path: Path) -> None:
        source = workspace(tmp_path / "w", "P/S1")
        (source / "P" / "S1" / "project.json").write_text("{}")
        import_source(source, tmp_path / "made")
        export(tmp_path / "made", tmp_path / "back", format="ecat-2018")
        assert contents(tmp_path / "back") == contents(source)

    def test_progress_counts_sessions(self, tmp_path: Path) -> None:
        said: list[tuple[str, int, int]] = []
        source = workspace(tmp_path / "w", "P/S1", "P/S2")
        import_source(source, tmp_path / "made", progress=lambda *args: said.append(args))
        assert said == [("S1", 0, 2), ("S1", 1, 2), ("S2", 1, 2), ("S2", 2, 2)]


class TestFailures:
    def test_one_bad_session_is_the_error_itself(self, tmp_path: Path) -> None:
        error = refusal(workspace(tmp_path / "w", "P/S1", "P/S2", bad="P/S2"), tmp_path / "made")
        assert (error.what, error.where) == (
            "cannot import S2/files.param",
            "line 7: expected a whole number of 32 bits, found 'x'",
        )
        assert error.consequence == f"nothing was written to {tmp_path / 'made'}"

    def test_several_bad_sessions_are_one_error_that_names_them(self, tmp_path: Path) -> None:
        source = workspace(tmp_path / "w", "P/S1", "P/S2", "Q/S3")
        for name in ("P/S1", "Q/S3"):
            (source / name / "files.param").write_text(BAD)
        error = refusal(source, tmp_path / "made")
        assert error.what == f"cannot import 2 of 3 sessions of {source}"
        assert [line.strip().partition(":")[0] for line in error.where.split("\n")] == [
            "cannot import S1/files.param",
            "cannot import S3/files.param",
        ]
        assert error.fix == "ecat import --keep-going imports the others"

    def test_a_hundred_bad_sessions_name_the_first_of_them(self, tmp_path: Path) -> None:
        source = workspace(tmp_path / "w", *(f"P/S{i}" for i in range(100)), text=BAD)
        assert len(refusal(source, tmp_path / "made").where.split("\n")) == 20

    def test_the_others_can_be_kept(self, tmp_path: Path) -> None:
        report = import_source(
            workspace(tmp_path / "w", "P/S1", "P/S2", bad="P/S2"), tmp_path / "made", keep_going=True
        )
        assert report.sessions == 1
        assert [path.name for path in find_sessions(tmp_path / "made")] == ["S1"]
        assert report.findings[0].startswith("S2: not imported: cannot import S2/files.param: line 7")

    def test_with_nothing_to_keep_there_is_still_an_error(self, tmp_path: Path) -> None:
        assert (
            "2 of 2"
            in refusal(
                workspace(tmp_path / "w", "P/S1", "P/S2", text=BAD), tmp_path / "made", keep_going=True
            ).what
        )

    def test_a_single_bad_session(self, tmp_path: Path) -> None:
        assert isinstance(refusal(save(tmp_path, BAD).parent, tmp_path / "made"), FormatError)

    def test_a_bad_rig_leaves_nothing(self, tmp_path: Path) -> None:
        rig = '<object id="o1" shape="Annotator.RigObject" source="rig_1.xml" sourceScheme="" />\n'
        folder = save(tmp_path, document(objects=rig)).parent
        (folder / "rig_1.xml").write_bytes(b"RIFF")
        assert "rig_1.xml" in refusal(folder, tmp_path / "made").what

    @pytest.mark.parametrize("name", ["nothing", "a.txt", "empty"])
    def test_a_wrong_source(self, tmp_path: Path, name: str) -> None:
        (tmp_path / "a.txt").write_text("x")
        (tmp_path / "empty").mkdir()
        assert f"cannot import {tmp_path / name}" == refusal(tmp_path / name, tmp_path / "made").what

    def test_a_destination_that_exists_stays(self, tmp_path: Path) -> None:
        (tmp_path / "made").mkdir()
        (tmp_path / "made" / "mine").write_text("x")
        error = refusal(workspace(tmp_path / "w", "P/S1"), tmp_path / "made")
        assert isinstance(error, ExistsError)
        assert contents(tmp_path / "made") == {"mine": b"x"}

    def test_an_export_onto_something_leaves_it(self, tmp_path: Path) -> None:
        import_source(workspace(tmp_path / "w", "S1") / "S1", tmp_path / "made")
        (tmp_path / "back").mkdir()
        (tmp_path / "back" / "mine").write_text("x")
        with pytest.raises(ExistsError):
            export(tmp_path / "made", tmp_path / "back", format="ecat-2018")
        assert contents(tmp_path / "back") == {"mine": b"x"}

    def test_an_export_that_fails_leaves_nothing(self, tmp_path: Path) -> None:
        import_source(workspace(tmp_path / "w", "P/S1", "P/S2"), tmp_path / "made")
        (tmp_path / "made" / "P" / "S2" / "annotations" / "main.xml").write_text("broken")
        before = sorted(tmp_path.rglob("*"))
        with pytest.raises(EcatError):
            export(tmp_path / "made", tmp_path / "back", format="ecat-2018")
        assert sorted(tmp_path.rglob("*")) == before


def test_a_project_without_sessions_keeps_its_list(tmp_path: Path) -> None:
    (tmp_path / "ws" / "A" / "S1").mkdir(parents=True)
    (tmp_path / "ws" / "A" / "S1" / "files.param").write_text('<session name="S1" length="3" />')
    (tmp_path / "ws" / "B").mkdir()
    (tmp_path / "ws" / "B" / "B.project").write_text("Session1\n")
    import_source(tmp_path / "ws", tmp_path / "made")
    export(tmp_path / "made", tmp_path / "back", format="ecat-2018")
    assert (tmp_path / "back" / "B" / "B.project").read_text() == "Session1\n"


def test_links_that_lead_back_do_not_multiply_sessions(tmp_path: Path) -> None:
    (tmp_path / "project" / "s").mkdir(parents=True)
    (tmp_path / "project" / "s" / "files.param").write_text('<session name="s" length="3" />')
    for i in range(6):
        (tmp_path / "project" / f"back{i}").symlink_to(".", target_is_directory=True)
    assert import_source(tmp_path / "project", tmp_path / "made").sessions == 1


def test_the_folder_one_stands_in_has_a_name_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "project" / "s").mkdir(parents=True)
    (tmp_path / "project" / "s" / "files.param").write_text('<session name="s" length="3" />')
    monkeypatch.chdir(tmp_path / "project" / "s")
    import_source(Path(), tmp_path / "made")
    assert open_session(tmp_path / "made").name == "s"


def test_whose_annotation_is_written_can_be_chosen(tmp_path: Path) -> None:
    import_source(workspace(tmp_path / "w", "p/S1"), tmp_path / "in")
    (path,) = find_sessions(tmp_path / "in")
    session = open_session(path)
    ours = session.layer("main")
    (said, *_) = ours.events
    with session.write() as commit:
        commit.put_layer(replace(ours, name="ann", events=(replace(said, text="Ann says so"),)))
    report = export(tmp_path / "in", tmp_path / "out", format="ecat-2018", options={"layer": "ann"})
    assert [finding for finding in report.findings if "left out" in finding] == [
        "S1: ECAT has one layer; 'main' was left out"
    ]
    assert b"Ann says so" in (tmp_path / "out" / "p" / "S1" / "files.param").read_bytes()
    export(tmp_path / "in", tmp_path / "usual", format="ecat-2018")
    assert b"Ann says so" not in (tmp_path / "usual" / "p" / "S1" / "files.param").read_bytes()
    with pytest.raises(NotFoundError, match="there is no layer bob; its layers are: "):
        export(tmp_path / "in", tmp_path / "none", format="ecat-2018", options={"layer": "bob"})
    assert not (tmp_path / "none").exists()
