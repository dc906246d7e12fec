"""Event exports of ECAT 2018 as sessions, and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ecat.check import check
from ecat.errors import FormatError
from ecat.formats import export, import_source, registry
from ecat.formats.ecat2018.learning_export import JOINTS, read_learning_export
from ecat.model import Event, Property, Role
from ecat.progress import silent
from ecat.store import TableData, find_sessions, open_project, open_session

RIG = ",".join(["1,2,3"] * 13)
BOX = ",".join(["1,2,3"] * 4)
EVENT = '<event start="0" end="20">Subject,None,Theme,pulls,From</event>'


def frame(number: int = 0, rig: str = RIG, second: str = BOX) -> str:
    parts = "".join(
        f'        <o type="{kind}">{text}</o>\r\n'
        for kind, text in (("rig", rig), ("glyph", BOX), ("glyph", second))
    )
    return f'      <frame no="{number}">\r\n{parts}      </frame>\r\n'


def one(name: str = "s", frames: str = frame(), events: str = EVENT) -> str:
    data = f"    <data>\r\n{frames}    </data>\r\n" if frames else "    <data />\r\n"
    said = f"    <events>\r\n      {events}\r\n    </events>\r\n" if events else "    <events />\r\n"
    return f'  <session name="{name}">\r\n{data}{said}  </session>\r\n'


def written(path: Path, *sessions: str, newline: str = "\r\n") -> Path:
    head = '\ufeff<?xml version="1.0" encoding="utf-8"?>\r\n<project>\r\n'
    path.write_bytes(f"{head}{''.join(sessions)}</project>".replace("\r\n", newline).encode())
    return path


def back(path: Path, dest: Path) -> bytes:
    report = export(path, dest, format="ecat-learning")
    assert report.findings == ()
    return dest.read_bytes()


class TestImport:
    def test_a_file_of_one_session_becomes_one_with_skeleton_boxes_and_events(self, tmp_path: Path) -> None:
        report = import_source(written(tmp_path / "pull.txt", one()), tmp_path / "s")
        assert (report.format, report.sessions) == ("ecat-learning", 1)
        session = open_session(tmp_path / "s")
        assert (session.manifest.n_frames, session.manifest.clock.rule) == (1, "unknown")
        layer = session.layer()
        assert [(thing.id, thing.kind, thing.dimensions) for thing in layer.objects] == [
            ("o1", "rig", 3),
            ("o2", "marker_box", 3),
            ("o3", "marker_box", 3),
        ]
        (event,) = layer.events
        assert (event.type, event.properties) == ("pulls", (Property("preposition", "From"),))
        assert event.roles == (Role(name="Subject", target="o1"), Role(name="Theme", target="o3"))
        assert [(s.start_frame, s.end_frame) for s in event.segments] == [(0, 21)]
        joints = session.table("joints").to_arrow()
        assert joints["joint"].to_pylist() == list(JOINTS)
        assert set(joints["object_id"].to_pylist()) == {"o1"}
        assert [joints[axis][0].as_py() for axis in "xyz"] == [-1, -2, 3]
        marks = session.table("markers_3d").to_arrow()
        assert marks["object_id"].to_pylist() == ["o2", "o3"]
        assert marks["code"].null_count == 2
        assert [marks[name][1].as_py() for name in ("x3", "y3", "z3")] == [-1, -2, 3]

    def test_the_session_is_sound(self, tmp_path: Path) -> None:
        import_source(written(tmp_path / "pull.txt", one()), tmp_path / "s")
        assert [f for f in check(tmp_path / "s", progress=silent) if f.severity == "error"] == []

    def test_a_file_of_several_becomes_a_project_in_folders_of_names_that_can_be(
        self, tmp_path: Path
    ) -> None:
        source = written(tmp_path / "pull.txt", one("b/1"), one("b:1"), one(""), one("../x"))
        assert import_source(source, tmp_path / "p").sessions == 4
        assert open_project(tmp_path / "p").manifest.kind == "project"
        assert sorted(path.name for path in find_sessions(tmp_path / "p")) == ["b_1", "b_1_2", "session", "x"]

    def test_a_folder_becomes_a_workspace_with_a_project_for_each_file(self, tmp_path: Path) -> None:
        folder = tmp_path / "data"
        folder.mkdir()
        written(folder / "pull.txt", one("a"))
        written(folder / "push.xml", one("a"), one("b"))
        (folder / "notes.txt").write_text("not an export")
        assert registry.sniff(folder).name == "ecat-learning"
        assert import_source(folder, tmp_path / "w").sessions == 3
        assert open_project(tmp_path / "w").manifest.kind == "workspace"
        assert [p.path.name for p in open_project(tmp_path / "w").children()] == ["pull", "push"]

    def test_what_was_odd_is_told_with_its_session(self, tmp_path: Path) -> None:
        source = written(tmp_path / "pull.txt", one("a"), one("b", frames=frame(3)))
        report = import_source(source, tmp_path / "p")
        assert report.findings == ("b: session b: its frames are not numbered 0, 1, 2, ...",)
        assert open_session(tmp_path / "p" / "b").manifest.provenance.notes

    def test_a_fault_leaves_nothing_unless_what_comes_before_is_to_be_kept(self, tmp_path: Path) -> None:
        source = written(
            tmp_path / "pull.txt", one("a"), one("b"), one("c", events=EVENT.replace("None,", ""))
        )
        with pytest.raises(FormatError, match="expected 5 labels"):
            import_source(source, tmp_path / "p")
        assert not (tmp_path / "p").exists()
        report = import_source(source, tmp_path / "p", keep_going=True)
        assert report.sessions == 2
        assert "what follows was left out" in report.findings[-1]

    def test_a_file_without_a_session_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(FormatError, match="there is no session in it"):
            import_source(written(tmp_path / "pull.txt"), tmp_path / "p")

    def test_other_xml_is_not_taken_for_it(self, tmp_path: Path) -> None:
        (tmp_path / "a.xml").write_text("<project><target/></project>")
        with pytest.raises(FormatError, match="looks like none of the formats"):
            registry.sniff(tmp_path / "a.xml")


class TestBack:
    def test_real_files_come_back_byte_for_byte(self, shared: Path, tmp_path: Path) -> None:
        folder = tmp_path / "some"
        folder.mkdir()
        for name in ("pushpast", "selfslidefrom"):
            (folder / f"{name}.txt").write_bytes(
                (shared / "actions_ch4" / "xml" / f"{name}.txt").read_bytes()
            )
        import_source(folder, tmp_path / "w")
        assert export(tmp_path / "w", tmp_path / "out", format="ecat-learning").findings == ()
        assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == {
            path.name: path.read_bytes() for path in folder.iterdir()
        }

    @pytest.mark.parametrize("newline", ["\n", "\r\n"])
    def test_order_names_line_ends_and_empty_sessions_are_kept(self, tmp_path: Path, newline: str) -> None:
        sessions = (one("s10"), '  <session name="s 2" />\r\n', one("s1", frames="", events=""), one("s1"))
        source = written(tmp_path / "pull.txt", *sessions, newline=newline)
        import_source(source, tmp_path / "p")
        assert back(tmp_path / "p", tmp_path / "out.txt") == source.read_bytes()

    @pytest.mark.parametrize(
        "event",
        [
            EVENT.replace("Subject,None", "None,None").replace("pulls,From", "None,None"),
            EVENT.replace("None", ""),
            EVENT.replace('"20"', '"-7"'),
            EVENT.replace('start="0"', 'start="-3"'),
            EVENT.replace("Theme", "Subject"),
            EVENT.replace("Theme", "a &amp; &lt;b"),
        ],
    )
    def test_labels_and_windows_of_all_kinds_are_kept(self, tmp_path: Path, event: str) -> None:
        source = written(tmp_path / "pull.txt", one(events=event))
        import_source(source, tmp_path / "s")
        assert back(tmp_path / "s", tmp_path / "out.txt") == source.read_bytes()

    def test_points_never_seen_are_kept(self, tmp_path: Path) -> None:
        seen = "0,0,0," + ",".join(["1,2,3"] * 3)
        source = written(tmp_path / "pull.txt", one(frames=frame(0, second=seen) + frame(1)))
        import_source(source, tmp_path / "s")
        assert open_session(tmp_path / "s").table("markers_3d").to_arrow()["x0"].null_count == 1
        assert back(tmp_path / "s", tmp_path / "out.txt") == source.read_bytes()

    def test_an_edit_is_not_hidden_by_what_the_file_said(self, tmp_path: Path) -> None:
        odd = EVENT.replace("None", "").replace('"20"', '"-7"')
        import_source(written(tmp_path / "pull.txt", one(events=odd)), tmp_path / "s")
        session = open_session(tmp_path / "s")
        layer = session.layer()
        (event,) = layer.events
        edited = replace(event, type="pushes", segments=(replace(event.segments[0], end_frame=9),))
        with session.write() as commit:
            commit.put_layer(replace(layer, events=(edited,)))
        back(tmp_path / "s", tmp_path / "out.txt")
        (again,) = read_learning_export(tmp_path / "out.txt")
        (row,) = again.events.to_pylist()
        assert (row["verb"], row["box1_role"], row["last_frame"]) == ("pushes", None, 8)

    def test_labels_that_could_not_be_read_again_are_left_out_and_told(self, tmp_path: Path) -> None:
        import_source(written(tmp_path / "pull.txt", one()), tmp_path / "s")
        session = open_session(tmp_path / "s")
        layer = session.layer()
        with session.write() as commit:
            commit.put_layer(replace(layer, events=(*layer.events, Event(id="a9", type="push, pull"))))
        report = export(tmp_path / "s", tmp_path / "out.txt", format="ecat-learning")
        assert len(report.findings) == 1
        assert "event a9 was left out" in report.findings[0]

    def test_a_session_without_two_boxes_and_a_skeleton_is_left_empty_as_ecat_did(
        self, tmp_path: Path
    ) -> None:
        import_source(written(tmp_path / "pull.txt", one()), tmp_path / "s")
        session = open_session(tmp_path / "s")
        marks = session.table("markers_3d").to_arrow()
        with session.write() as commit:
            commit.put_table("markers_3d", TableData(data=marks.slice(0, 1)))
        report = export(tmp_path / "s", tmp_path / "out.txt", format="ecat-learning")
        assert "left empty" in report.findings[0]
        (again,) = read_learning_export(tmp_path / "out.txt")
        assert again.empty
