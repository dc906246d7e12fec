"""The other verbs: what they call, print and return."""

from __future__ import annotations

import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from ecat import formats
from ecat.cli import main
from ecat.cli.output import Output
from ecat.cli.text import shell
from ecat.errors import InputError
from ecat.formats import ImportReport
from ecat.model import Manifest
from ecat.process import ProcessReport
from ecat.progress import Progress
from ecat.store import Draft, create_session, open_session
from tests.store.media.clips import depth_clip

if TYPE_CHECKING:
    from conftest import Ecat


UNMEASURED = (
    "note: clock: times follow from the number of frames and the duration, as there is no table frames: "
    "gaps, drift and repeated frames were not looked for [clock-unknown]\n"
    "  --repair leaves it as it is; nothing has to be done if the recorder wrote no times\n"
)


def test_check_of_a_healthy_session(ecat: Ecat, session: Path) -> None:
    result = ecat("check", session)
    assert (result.code, result.out, result.err) == (0, f"{UNMEASURED}1 note\n", "")


def test_check_says_where_what_and_the_way_out(ecat: Ecat, session: Path) -> None:
    leftover = session / "tables" / ".poses.parquet.0123456789abcdef.new"
    leftover.touch()
    result = ecat("check", session)
    assert result.code == 0  # a warning
    assert result.out == (
        f"warning: {leftover.name}: left behind by a write that was interrupted [leftover]\n"
        f"  --repair would remove it: ecat check {session} --repair\n"
        f"{UNMEASURED}1 warning, 1 note\n"
    )
    result = ecat("check", session, "--repair")
    assert (result.code, result.out) == (0, f"repaired: {leftover.name}: remove it\n{UNMEASURED}1 note\n")


def test_check_of_a_sick_session_is_exit_code_1_until_it_is_repaired(ecat: Ecat, session: Path) -> None:
    file = session / "annotations" / "main.xml"
    file.write_text(file.read_text("utf-8").replace("Shell", "Shall"), "utf-8")
    result = ecat("check", session, "--json")
    assert (result.code, result.json["ok"]) == (1, False)
    finding, _ = result.json["findings"]
    assert (finding["severity"], finding["code"], finding["session"]) == ("error", "layer-edited", ".")
    assert finding["fix"] == f"ecat check {session} --repair"
    repaired = ecat("check", session, "--repair", "--json")
    assert (repaired.code, len(repaired.json["findings"]), len(repaired.json["repaired"])) == (0, 1, 1)
    assert "Shall" in open_session(session).objects.to_arrow()["name"].to_pylist()


@pytest.mark.slow
def test_a_repair_that_fails_is_said_with_the_reason(ecat: Ecat, session: Path) -> None:
    assert ecat("process", session, "--quiet").code == 0
    for name in ("poses", "markers_2d"):
        (session / "tables" / f"{name}.parquet").unlink()
    result = ecat("check", session, "--repair")
    assert result.code == 1
    assert result.out.startswith("not repaired: table poses: cannot read table markers_2d\n")
    result = ecat("check", session, "--repair", "--json")
    ((failure,), finding) = result.json["failures"], result.json["findings"][0]
    assert failure["finding"]["place"] == "table poses"
    assert failure["error"]["what"] == "cannot read table markers_2d"
    assert finding["fix"].endswith("ecat import RECORDING NEW_FOLDER")


def test_check_can_be_asked_for_the_exit_code_only(ecat: Ecat, session: Path) -> None:
    (session / "session.json").write_text("{", "utf-8")
    result = ecat("check", session, "--quiet")
    assert (result.code, result.out, result.err) == (1, "", "")


def test_check_of_a_project_names_the_session(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    shutil.move(session, tmp_path / "project" / "slide")
    (tmp_path / "project" / "slide" / "session.json").write_text("{", "utf-8")
    assert ecat("check", tmp_path / "project").out.startswith("error: slide: session.json: ")


def test_sample_makes_the_same_session_again(ecat: Ecat, tmp_path: Path) -> None:
    for name in ("a", "b"):
        made = ecat(
            "sample",
            tmp_path / name / "s",
            "--seed",
            5,
            "--actions",
            "away",
            "--truth",
            tmp_path / name / "t",
        )
        assert (made.code, made.err) == (0, "")
    first, second = (
        {
            path.relative_to(tmp_path / name): path.read_bytes()
            for path in (tmp_path / name).rglob("*")
            if path.is_file()
        }
        for name in ("a", "b")
    )
    assert first == second
    assert Path("t/poses.parquet") in first


def test_sample_refuses_actions_that_it_does_not_know(ecat: Ecat, tmp_path: Path) -> None:
    result = ecat("sample", tmp_path / "s", "--actions", "next,fly")
    assert result.code == 2
    assert "fly" in result.err
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("dest", "truth"), [("s", "s"), ("s", "s/truth"), ("t/s", "t"), ("s", "file/truth"), ("s", "taken")]
)
def test_sample_makes_session_and_truth_or_neither(ecat: Ecat, tmp_path: Path, dest: str, truth: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "taken" / "by").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    result = ecat("sample", tmp_path / dest, "--actions", "next", "--truth", tmp_path / truth)
    assert result.code in {1, 2}
    assert len(result.err.splitlines()) == 4
    assert sorted(tmp_path.rglob("*")) == before


def test_formats_says_what_can_be_done_with_each(ecat: Ecat) -> None:
    lines = {line.split()[0]: line.split() for line in ecat("formats").out.splitlines()}
    assert lines["ecat-2018"][1:3] == ["import", "export"]
    known = {entry["name"]: entry for entry in ecat("formats", "--json").json["formats"]}
    assert known["poses"]["reads"] is False


def test_a_session_goes_out_and_comes_back(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    out = ecat("export", session, tmp_path / "out", "--format", "ecat-2018")
    assert (out.code, out.out.splitlines()[0]) == (0, f"exported 1 session (ecat-2018) to {tmp_path / 'out'}")
    back = ecat("import", tmp_path / "out", tmp_path / "back", "--json")
    assert (back.code, back.json["format"], back.json["sessions"]) == (0, "ecat-2018", 1)


@pytest.mark.parametrize("verb", ["import", "export"])
def test_nothing_is_written_into_what_is_read(ecat: Ecat, session: Path, verb: str) -> None:
    before = sorted(session.rglob("*"))
    result = ecat(verb, session, session / "media" / "new", "--format", "ecat-2018")
    assert (result.code, result.err.splitlines()[0]) == (
        2,
        f"ecat: cannot write to {session / 'media' / 'new'}",
    )
    assert sorted(session.rglob("*")) == before


def test_import_hands_its_options_on(ecat: Ecat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[dict[str, Any]] = []

    def fake(source: Path, dest: Path, **options: Any) -> ImportReport:
        calls.append({"source": source, "dest": dest, **options})
        return ImportReport(path=dest, format="poses", sessions=2, findings=("one marker was skipped",))

    monkeypatch.setattr(formats, "import_source", fake)
    result = ecat("import", "in", "out", "--format", "poses", "--skip-bad-markers", "--keep-going")
    assert result.out == "imported 2 sessions (poses) to out\n  one marker was skipped\n"
    (call,) = calls
    assert callable(call.pop("progress"))
    assert call == {
        "source": Path("in"),
        "dest": Path("out"),
        "format": "poses",
        "skip_bad_markers": True,
        "keep_going": True,
    }


def test_import_of_an_unknown_format_lists_those_there_are(ecat: Ecat, tmp_path: Path) -> None:
    result = ecat("import", tmp_path / "tape", tmp_path / "out", "--format", "betamax")
    assert result.code == 2
    assert "ecat-2018" in result.err


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Instead of running stages: what was asked for.  Sessions called ``bad`` fail."""
    calls: list[dict[str, Any]] = []

    def fake(path: Path, **options: Any) -> ProcessReport:
        calls.append({"path": path, **options})
        options["progress"]("pose", 1, 2)
        if path.name == "bad":
            raise InputError("cannot run the stage pose on bad", where="there is no table markers_2d")
        return ProcessReport(
            path=path,
            ran=("plane",),
            skipped=("pose",),
            not_applicable={"smooth": "no poses"},
            findings=("a remark",),
        )

    monkeypatch.setattr("ecat.batch.processing.process_session", fake)
    monkeypatch.setattr("ecat.batch.processing.calibrate_together", lambda *_: {})
    return calls


def test_process_hands_its_options_on(ecat: Ecat, session: Path, stages: list[dict[str, Any]]) -> None:
    result = ecat("process", session, "--stage", "pose", "--smooth", "--force")
    assert result.out == (
        f"{session}: ran plane; up to date: pose; not applicable: smooth (no poses)\n  a remark\n"
    )
    (call,) = stages
    assert (call["stages"], call["smooth"], call["force"], call["prototypes"]) == (
        ("pose",),
        True,
        True,
        None,
    )


def test_process_goes_on_after_a_session_that_fails_and_a_path_that_is_wrong(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]]
) -> None:
    bad, nowhere = shutil.copytree(session, session.parent / "bad"), session.parent / "nowhere"
    result = ecat("process", bad, nowhere, session)
    assert [call["path"] for call in stages] == [bad, session]
    assert result.code == 1
    assert result.out.splitlines()[0].startswith(f"{session}: ran plane")
    assert f"{nowhere}: cannot find sessions in nowhere" in result.out
    assert f"{bad}: cannot run the stage pose on bad\n  there is no table markers_2d" in result.out
    assert result.out.endswith("1 session processed, 2 failed\n")


def test_what_failed_is_also_said_in_quiet(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]], tmp_path: Path
) -> None:
    project = tmp_path / "project"
    for name in ("bad", "good"):
        shutil.copytree(session, project / name)
    (project / "bad" / "session.json").write_text("{", "utf-8")
    export = ("export", project, tmp_path / "data", "--format", "parquet")
    for words in (("process", project), export, ("stats", project)):
        result = ecat(*words, "--quiet")
        assert (result.code, result.out) == (1, "")
        assert result.err.startswith("ecat: cannot ")
        assert "bad" in result.err
    del stages


def test_process_as_json_has_a_list_of_sessions_and_one_of_failures(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]]
) -> None:
    bad, nowhere = shutil.copytree(session, session.parent / "bad"), session.parent / "nowhere"
    result = ecat("process", bad, session, nowhere, "--json")
    assert (result.code, result.json["ok"]) == (1, False)
    assert result.json["sessions"] == [
        {
            "path": str(session),
            "ran": ["plane"],
            "up_to_date": ["pose"],
            "not_applicable": {"smooth": "no poses"},
            "findings": ["a remark"],
        }
    ]
    assert [(f["path"], f["error"]["error"]) for f in result.json["failures"]] == [
        (str(nowhere), "NotFoundError"),
        (str(bad), "InputError"),
    ]


def test_the_error_of_a_single_session_is_the_error(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]]
) -> None:
    bad = session.rename(session.parent / "bad")
    result = ecat("process", bad)
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith("ecat: cannot run the stage pose on bad\n")


def test_a_session_that_is_named_twice_is_processed_once(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]]
) -> None:
    assert ecat("process", session, session.parent, session).code == 0
    assert [call["path"] for call in stages] == [session]


def test_an_unknown_stage_is_a_wrong_call_however_many_sessions_there_are(ecat: Ecat, session: Path) -> None:
    result = ecat("process", session, session.parent, "--stage", "fold")
    assert result.code == 2
    assert result.err.startswith("ecat: unknown stage fold\n")


def test_progress_tells_sessions_of_the_same_name_apart(
    session: Path, tmp_path: Path, stages: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    @contextmanager
    def listen(_: Output) -> Generator[Progress]:
        yield lambda what, done, total: said.append(what)

    monkeypatch.setattr(Output, "progress", listen)
    for group in "ab":
        shutil.copytree(session, tmp_path / "all" / group / "one")
    assert main(["process", str(tmp_path / "all"), "--quiet"]) == 0
    assert said == ["a/one (1 of 2): pose", "b/one (2 of 2): pose"]


def test_process_says_why_a_film_is_not_processed(ecat: Ecat, tmp_path: Path) -> None:
    create_session(tmp_path / "film", Draft(manifest=Manifest(name="film", created="2026")))
    result = ecat("process", tmp_path / "film")
    assert (result.code, result.err) == (0, "")
    assert result.out == (
        f"{tmp_path / 'film'}: not applicable: track, hull (no color video in this session); "
        "not applicable: face_planes, outline (no depth video in this session); "
        "not applicable: plane, pose, relations, propose (no markers in this session)\n"
    )


@pytest.mark.slow
def test_process_in_two_processes(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    for name in "ab":
        shutil.copytree(session, tmp_path / "project" / name)
    result = ecat("process", tmp_path / "project", "--jobs", 2)
    assert result.code == 0
    assert [line.split(": ")[1] for line in result.out.splitlines()] == [
        "ran plane, pose, relations, propose; not applicable"
    ] * 2


@pytest.mark.parametrize("verb", ["info", "process", "check"])
def test_a_file_is_not_taken_for_a_folder(ecat: Ecat, session: Path, tmp_path: Path, verb: str) -> None:
    (tmp_path / "a film.avi").write_bytes(b"RIFF")
    result = ecat(verb, tmp_path / "a film.avi")
    assert result.code == 1
    assert "it is a file, not a folder" in result.err
    assert f"ecat import '{tmp_path / 'a film.avi'}' MY_SESSION" in result.err
    inside = ecat(verb, session / "tables" / "events.parquet", "--json").json["error"]
    assert inside["fix"] == f"name the folder that it belongs to: {session}"


@pytest.mark.parametrize(
    "line",
    [
        ("process", "s3://lab/p"),
        ("process", ".", "s3://lab/p", "--force"),
        ("check", "s3://lab/p"),
        ("annotate", "s3://lab/p"),
        ("event", "list", "s3://lab/p"),
        ("agree", "s3://lab/p"),
        ("apply", "s3://lab/p", "-"),
        ("import", ".", "s3://lab/p"),
        ("view", ".", "--save=s3://lab/p"),
        ("project", "archive", "s3://lab/p"),
    ],
)
def test_a_url_is_not_taken_for_a_path(
    ecat: Ecat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    result = ecat(*line)
    assert result.code == 2
    assert result.err.startswith("ecat: cannot use s3://lab/p here\n  it is a URL")
    assert "read a copy in a folder" in result.err
    assert not list(tmp_path.iterdir())


def test_view_can_save_a_recording(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    file = tmp_path / "slide.rrd"
    result = ecat("view", session, "--save", file)
    assert (result.code, result.err) == (0, "")
    assert result.out == f"wrote {file}\ntry: {shell('rerun', file)}\n"
    assert file.read_bytes()[:4] == b"RRF2"


def test_view_says_which_streams_cannot_be_shown(ecat: Ecat, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    depth_clip(folder / "depth.mkv", 6)
    ecat("import", folder, tmp_path / "s")
    media = tmp_path / "s" / "media" / "depth.mkv"
    media.write_bytes(media.read_bytes()[:300])
    result = ecat("view", tmp_path / "s", "--save", tmp_path / "s.rrd")
    assert result.code == 0
    assert "\n  stream depth: could " in result.out
    (finding,) = ecat("view", tmp_path / "s", "--save", tmp_path / "s.rrd", "--json").json["findings"]
    assert finding.startswith("stream depth: could ")
