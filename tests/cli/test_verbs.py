"""The other verbs: what they call, print and return."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from ecat import formats, process
from ecat.errors import InputError
from ecat.formats import ImportReport
from ecat.process import ProcessReport
from ecat.store import open_session

if TYPE_CHECKING:
    from conftest import Ecat


def test_check_of_a_healthy_session(ecat: Ecat, session: Path) -> None:
    result = ecat("check", session)
    assert (result.code, result.out, result.err) == (0, "no findings\n", "")


def test_check_says_where_what_and_the_way_out(ecat: Ecat, session: Path) -> None:
    leftover = session / "tables" / ".poses.parquet.0123456789abcdef.new"
    leftover.touch()
    result = ecat("check", session)
    assert result.code == 0  # a warning
    assert result.out == (
        f"warning: {leftover.name}: left behind by a write that was interrupted [leftover]\n"
        "  --repair would: remove it\n"
        "1 warning\n"
    )
    result = ecat("check", session, "--repair")
    assert (result.code, result.out) == (0, f"repaired: {leftover.name}: remove it\nno findings\n")


def test_check_of_a_sick_session_is_exit_code_1_until_it_is_repaired(ecat: Ecat, session: Path) -> None:
    file = session / "annotations" / "main.xml"
    file.write_text(file.read_text("utf-8").replace("Shell", "Shall"), "utf-8")
    result = ecat("check", session, "--json")
    assert (result.code, result.json["ok"]) == (1, False)
    (finding,) = result.json["findings"]
    assert (finding["severity"], finding["code"], finding["session"]) == ("error", "layer-edited", ".")
    repaired = ecat("check", session, "--repair", "--json")
    assert (repaired.code, repaired.json["findings"], len(repaired.json["repaired"])) == (0, [], 1)
    assert "Shall" in open_session(session).objects.to_arrow()["name"].to_pylist()


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


def test_import_of_an_unknown_format_lists_those_there_are(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    result = ecat("import", session, tmp_path / "out", "--format", "betamax")
    assert result.code == 2
    assert "ecat-2018" in result.err


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Instead of running stages: what was asked for.  Sessions called ``bad`` fail."""
    calls: list[dict[str, Any]] = []

    def fake(path: Path, **options: Any) -> ProcessReport:
        calls.append({"path": path, **options})
        options["progress"]("poses", 1, 2)
        if path.name == "bad":
            raise InputError("cannot run the stage poses on bad", where="there is no table markers_2d")
        return ProcessReport(path=path, ran=("poses",), skipped=("table_plane",), findings=("a remark",))

    monkeypatch.setattr(process, "process_session", fake)
    return calls


def test_process_hands_its_options_on(ecat: Ecat, session: Path, stages: list[dict[str, Any]]) -> None:
    result = ecat("process", session, "--stage", "poses", "--smooth", "--force")
    assert result.out == f"{session}: ran poses; up to date: table_plane\n  a remark\n"
    (call,) = stages
    assert (call["stages"], call["smooth"], call["force"], call["prototypes"]) == (
        ("poses",),
        True,
        True,
        None,
    )


def test_process_goes_on_after_a_session_that_fails(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]]
) -> None:
    bad = shutil.copytree(session, session.parent / "bad")
    result = ecat("process", bad, session)
    assert [call["path"] for call in stages] == [bad, session]
    assert result.code == 1
    assert "there is no table markers_2d" in result.out
    assert result.out.endswith("1 session processed, 1 failed\n")


def test_process_as_json_has_an_entry_per_session(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]]
) -> None:
    bad = shutil.copytree(session, session.parent / "bad")
    result = ecat("process", bad, session, "--json")
    first, second = result.json["sessions"]
    assert (result.code, result.json["ok"]) == (1, False)
    assert first["error"]["error"] == "InputError"
    assert (second["ran"], second["skipped"]) == (["poses"], ["table_plane"])


def test_the_error_of_a_single_session_is_the_error(
    ecat: Ecat, session: Path, stages: list[dict[str, Any]]
) -> None:
    bad = session.rename(session.parent / "bad")
    result = ecat("process", bad)
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith("ecat: cannot run the stage poses on bad\n")


def test_view_can_save_a_recording(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    file = tmp_path / "slide.rrd"
    result = ecat("view", session, "--save", file)
    assert (result.code, result.err) == (0, "")
    assert result.out == f"wrote {file}\ntry: rerun {file}\n"
    assert file.read_bytes()[:4] == b"RRF2"
