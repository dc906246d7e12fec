"""A session folder becomes a session, and a session a folder."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from ecat.errors import EcatError, ReadOnlyError
from ecat.formats import export, import_source
from ecat.formats.ecat2018.body_scheme import KINECT_V2, write_body_scheme
from ecat.formats.ecat2018.depth_file import write_depth_file
from ecat.formats.ecat2018.session_folder import draft_of, write_session
from ecat.formats.format import ImportOptions
from ecat.model import Manifest, Provenance, Stream
from ecat.store import Draft, create_session, open_session
from tests.formats.ecat2018.documents import (
    POINTS,
    box,
    box_marker,
    document,
    face,
    location,
    markers,
    obj,
    save,
)

RIG = (
    '    <object id="o1" name="" filename="" objectType="3D" generate="PROVIDED" color="-65536" borderSize="1" '
    'semanticType="bodyRig" shape="Annotator.RigObject" rigIndex="3" source="rig_1.xml" '
    'sourceScheme="bodyScheme.xml" />\n'
)


def draft(folder: Path) -> tuple[Draft, list[str]]:
    findings: list[str] = []
    return draft_of(folder, ImportOptions(), findings), findings


def session_folder(tmp_path: Path, text: str = document(), **others: bytes) -> Path:
    folder = save(tmp_path, text).parent
    for name, data in others.items():
        (folder / name.replace("__", ".")).write_bytes(data)
    return folder


def imported_and_back(folder: Path, tmp_path: Path) -> tuple[Path, list[str]]:
    made, _ = draft(folder)
    session = create_session(tmp_path / "made", made)
    findings: list[str] = []
    back = tmp_path / "back"
    back.mkdir()
    write_session(session, back, findings)
    return back, findings


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class TestStreams:
    def test_files_are_streams_whether_they_are_there_or_not(self, tmp_path: Path) -> None:
        files = "    <file>rgb.AVI</file>\n    <file>depth.dep</file>\n    <file>rig_1.xml</file>\n"
        made, _ = draft(session_folder(tmp_path, document(files=files), rgb__AVI=b"x", notes__txt=b"y"))
        assert [(s.name, s.kind, s.file, s.present) for s in made.manifest.streams] == [
            ("rgb.AVI", "color", "media/rgb.AVI", True),
            ("depth.dep", "depth", "", False),
            ("rig_1.xml", "skeleton", "", False),
            ("notes.txt", "other", "media/notes.txt", True),
        ]
        assert made.manifest.cameras

    def test_a_file_whose_name_is_not_utf8_is_left_out_and_said_so(self, tmp_path: Path) -> None:
        folder = session_folder(tmp_path)
        (folder / os.fsdecode(b"depth_\xff.dep")).write_bytes(b"")
        made, findings = draft(folder)
        assert made.manifest.streams == ()
        assert any("depth_\\udcff.dep was not imported: its name is not UTF-8" in text for text in findings)

    def test_a_movie_session_has_no_cameras(self, tmp_path: Path) -> None:
        made, _ = draft(session_folder(tmp_path, a__avi=b"x"))
        assert made.manifest.cameras == ()

    @pytest.mark.parametrize(
        "name",
        [
            "../secret",
            "a/../../secret",
            "/etc/passwd",
            "C:\\x\\a.avi",
            "..",
            ".",
            "",
            "files.param",
            "n" * 300,
            "a:b",
            "x" * 5000,
        ],
    )
    def test_a_name_that_leads_elsewhere_names_no_file(self, tmp_path: Path, name: str) -> None:
        (tmp_path / "secret").write_bytes(b"not yours")
        folder = session_folder(
            tmp_path, document(files=f"    <file>{name}</file>\n".replace("></file>", " />"))
        )
        made, _ = draft(folder)
        assert made.files == {}
        back, _ = imported_and_back(folder, tmp_path)
        assert contents(back) == contents(folder)

    def test_a_link_that_leaves_the_folder_is_not_followed(self, tmp_path: Path) -> None:
        (tmp_path / "secret.avi").write_bytes(b"not yours")
        folder = session_folder(tmp_path, document(files="    <file>a.avi</file>\n"))
        (folder / "a.avi").symlink_to(tmp_path / "secret.avi")
        made, _ = draft(folder)
        assert made.files == {}

    def test_names_that_a_file_system_may_not_have_are_changed_and_come_back(self, tmp_path: Path) -> None:
        folder = session_folder(tmp_path, document(), **{"what? a*b.txt": b"x", "what_ a_b.txt": b"y"})
        made, _ = draft(folder)
        assert {s.file for s in made.manifest.streams} == {"media/what_ a_b.txt", "media/2_what_ a_b.txt"}
        back, _ = imported_and_back(folder, tmp_path)
        assert contents(back) == contents(folder)

    def test_a_hand_edited_session_does_not_write_outside_of_the_export(self, tmp_path: Path) -> None:
        (tmp_path / "a.avi").write_bytes(b"x")
        stream = Stream(name="../../evil.avi", file="media/a.avi", present=True)
        manifest = Manifest(
            name="s", created="", streams=(stream,), provenance=Provenance(format="ecat-2018")
        )
        session = create_session(
            tmp_path / "s", Draft(manifest=manifest, files={stream.name: tmp_path / "a.avi"})
        )
        back = tmp_path / "deep" / "back"
        back.mkdir(parents=True)
        findings: list[str] = []
        write_session(session, back, findings)
        assert findings == [
            "s: stream ../../evil.avi: '../../evil.avi' cannot name a file of a session; left out"
        ]
        assert not list(tmp_path.rglob("evil.avi"))

    def test_a_skeleton_that_is_not_there_does_not_write_elsewhere_either(self, tmp_path: Path) -> None:
        files = "    <file>rig_/../../x.xml</file>\n"
        back, _ = imported_and_back(session_folder(tmp_path, document(files=files, objects=RIG)), tmp_path)
        assert contents(back).keys() == {"files.param"}

    def test_ten_thousand_files_of_one_name_are_told_apart_at_once(self, tmp_path: Path) -> None:
        files = "".join(f"    <file>d{i}/x.avi</file>\n" for i in range(10_000))
        made, _ = draft(session_folder(tmp_path, document(files=files)))
        assert len({stream.name for stream in made.manifest.streams}) >= 10_000


class TestFolders:
    def test_a_folder_without_a_session_file_is_an_empty_session(self, tmp_path: Path) -> None:
        folder = tmp_path / "Session1"
        folder.mkdir()
        made, findings = draft(folder)
        assert (made.manifest.n_frames, made.layers[0].objects, findings) == (0, (), [])
        back, _ = imported_and_back(folder, tmp_path)
        assert contents(back) == {}

    def test_what_is_left_of_an_interrupted_save_is_told(self, tmp_path: Path) -> None:
        folder = session_folder(tmp_path)
        (folder / "~files.param").write_bytes(b"x")
        made, findings = draft(folder)
        assert findings == ["Session1: ~files.param is left of an interrupted save; not imported"]
        assert made.manifest.streams == ()

    def test_folders_in_a_session_are_told(self, tmp_path: Path) -> None:
        folder = session_folder(tmp_path)
        (folder / "old").mkdir()
        assert draft(folder)[1] == ["Session1: the folder old was not imported"]

    def test_many_findings_are_a_few_and_a_count(self, tmp_path: Path) -> None:
        said = document(objects="".join(obj(id="o1") for _ in range(151)))
        made, findings = draft(session_folder(tmp_path, said))
        assert len(findings) == 101
        assert findings[-1] == "Session1: and 50 more like these"
        assert len(made.manifest.provenance.notes) == 101

    def test_a_folder_that_cannot_be_read_is_one_error(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        folder = session_folder(tmp_path)

        def denied(self: Path) -> list[Path]:
            raise PermissionError(13, "Permission denied", str(self))

        monkeypatch.setattr(Path, "iterdir", denied)
        with pytest.raises(ReadOnlyError):
            draft(folder)

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
    def test_a_pipe_is_no_session_file(self, tmp_path: Path) -> None:
        folder = tmp_path / "Session1"
        folder.mkdir()
        os.mkfifo(folder / "files.param")
        with pytest.raises(EcatError, match=r"cannot import Session1/files\.param"):
            draft(folder)


def rig_file() -> bytes:
    points = ",".join(["1,2,3"] * 25)
    return (
        '<BodyDataSequence><Body_Data><Subject id="3" /><Timestamp frame="1" time="0" />'
        f"<Skeleton_Joint_Locations_Orig><Pts>{points}</Pts></Skeleton_Joint_Locations_Orig></Body_Data></BodyDataSequence>"
    ).encode()


class TestRigs:
    def test_skeletons_that_nobody_made_objects_of_are_read_all_the_same(self, tmp_path: Path) -> None:
        made, findings = draft(session_folder(tmp_path, document(), rig_1__xml=rig_file()))
        joints = made.tables["joints"].data
        assert isinstance(joints, pa.Table)
        assert joints.num_rows == 25
        assert joints["object_id"].null_count == 25
        assert not [line for line in findings if "rig_1.xml" in line]

    def test_a_rig_file_that_nobody_refers_to_may_be_broken(self, tmp_path: Path) -> None:
        made, findings = draft(session_folder(tmp_path, document(), rig_1__xml=b"no xml"))
        assert "joints" not in made.tables
        assert [line for line in findings if "rig_1.xml: copied, but not read" in line]

    def test_a_video_of_any_length_takes_no_memory(self, tmp_path: Path) -> None:
        said = document(objects=RIG).replace('length="', 'length="99999', 1)
        folder = session_folder(tmp_path, said, rig_1__xml=rig_file())
        tracemalloc.start()
        made, _ = draft(folder)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert made.manifest.n_frames > 9_000_000
        assert "joints" in made.tables
        assert most < 32 << 20

    @pytest.mark.parametrize(("index", "rows"), [("3", 25), ("2", 0), ("²", 25), ("9" * 5000, 25), ("", 25)])
    def test_joints_are_those_of_the_rig_s_body(self, tmp_path: Path, index: str, rows: int) -> None:
        said = document(objects=RIG.replace('rigIndex="3"', f'rigIndex="{index}"'))
        scheme = b"".join([write_body_scheme(KINECT_V2)])
        made, _ = draft(session_folder(tmp_path, said, rig_1__xml=rig_file(), bodyScheme__xml=scheme))
        joints = made.tables.get("joints")
        assert (0 if joints is None else joints.data.num_rows) == rows  # type: ignore[union-attr]

    def test_the_files_of_a_rig_come_back(self, tmp_path: Path) -> None:
        folder = session_folder(tmp_path, document(objects=RIG), rig_1__xml=rig_file(), bodyScheme__xml=b"")
        (folder / "bodyScheme.xml").write_bytes(write_body_scheme(KINECT_V2))
        back, _ = imported_and_back(folder, tmp_path)
        assert contents(back) == contents(folder)


def test_marks_and_annotation_are_in_the_session(tmp_path: Path) -> None:
    objects = box(box_marker(0, face(), face()), box_marker(0, face(POINTS), dimensions=3)) + obj(
        markers(location(1)), id="o2"
    )
    made, _ = draft(session_folder(tmp_path, document(objects=objects)))
    create_session(tmp_path / "made", made)
    session = open_session(tmp_path / "made")
    assert session.table("markers_2d").num_rows == 2
    assert session.table("markers_3d").num_rows == 1
    assert session.objects.to_arrow()["kind"].to_pylist() == ["marker_box", "rectangle"]


def test_other_layers_are_left_out_and_told(tmp_path: Path) -> None:
    made, _ = draft(session_folder(tmp_path))
    session = create_session(tmp_path / "made", made)
    with session.write() as commit:
        commit.put_layer(type(made.layers[0])(name="gold"))
    findings: list[str] = []
    (tmp_path / "back").mkdir()
    write_session(session, tmp_path / "back", findings)
    assert findings == ["Session1: ECAT has one layer; 'gold' was left out"]


class TestDepthFiles:
    def session(self, folder: Path) -> Path:
        frames = [(10 + 33 * i, np.full((4, 6), 700 + i, np.uint16)) for i in range(3)]
        (folder / "Session1").mkdir()
        write_depth_file(folder / "Session1" / "depth_1.dep", frames)
        text = '<session name="Session1" length="3"><files><file>depth_1.dep</file></files></session>'
        (folder / "Session1" / "files.param").write_text(text)
        return folder / "Session1"

    def test_recorded_times_become_a_table(self, tmp_path: Path) -> None:
        import_source(self.session(tmp_path), tmp_path / "made")
        made = open_session(tmp_path / "made")
        assert [stream.n_frames for stream in made.manifest.streams] == [3]
        frames = made.table("frames").to_arrow().to_pylist()
        assert [(row["t_ns"], row["frame"]) for row in frames] == [
            (10_000_000, 0),
            (43_000_000, 1),
            (76_000_000, 2),
        ]

    def test_a_crashed_recording_is_told(self, tmp_path: Path) -> None:
        source = self.session(tmp_path)
        data = (source / "depth_1.dep").read_bytes()
        (source / "depth_1.dep").write_bytes(data[:-30])
        report = import_source(source, tmp_path / "made")
        assert any("depth_1.dep" in finding for finding in report.findings)
        assert not open_session(tmp_path / "made").has_table("frames")


def test_a_listed_file_that_was_not_there_is_not_invented(tmp_path: Path) -> None:
    (tmp_path / "Session1").mkdir()
    text = '<session name="Session1" length="3"><files><file>bodyScheme.xml</file></files></session>'
    (tmp_path / "Session1" / "files.param").write_text(text)
    import_source(tmp_path / "Session1", tmp_path / "made")
    export(tmp_path / "made", tmp_path / "back", format="ecat-2018")
    assert [path.name for path in (tmp_path / "back").iterdir()] == ["files.param"]
