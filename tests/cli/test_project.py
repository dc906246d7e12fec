"""A project of one's own, and recordings that are brought into it."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from ecat.store import open_project

if TYPE_CHECKING:
    from conftest import Ecat


def test_a_new_project_is_filled_by_importing_into_it(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    project = tmp_path / "my project"
    made = ecat("project", "new", project, "--json")
    assert (made.code, made.json["name"]) == (0, "my project")
    assert ecat("export", session, tmp_path / "old" / "take", "--format", "ecat-2018").code == 0
    for name in ("one", "two"):
        assert ecat("import", tmp_path / "old" / "take", project / name).code == 0
    assert [path.name for path in open_project(project).session_paths()] == ["one", "two"]
    assert ecat("info", project, "--json").json["kind"] == "project"
    assert ecat("check", project).code == 0


def test_a_session_that_is_removed_is_missed_where_it_is_named(
    ecat: Ecat, session: Path, tmp_path: Path
) -> None:
    project = tmp_path / "project"
    ecat("project", "new", project)
    shutil.copytree(session, project / "one")
    shutil.copytree(session, project / "two")
    (thing, *_) = ecat("object", "list", project / "one", "--json").json["objects"]
    names = (thing["id"], f"two/{thing['id']}")
    assert ecat("relation", "add", project / "one", "IDENTITY", *names, "--from", 0).code == 0
    shutil.rmtree(project / "two")
    found = ecat("check", project, "--json").json["findings"]
    assert "dangling-session-reference" in {finding["code"] for finding in found}


def test_importing_onto_a_project_says_how_to_import_into_it(
    ecat: Ecat, session: Path, tmp_path: Path
) -> None:
    project = tmp_path / "project"
    ecat("project", "new", project)
    result = ecat("import", session, project, "--json")
    assert result.code == 1
    assert result.json["error"]["error"] == "ExistsError"
    assert result.json["error"]["fix"].endswith(f"import {session} {project / 'slide'}")
    assert [path.name for path in project.iterdir()] == ["project.json"]


def test_what_is_there_is_not_made_a_project(ecat: Ecat, session: Path) -> None:
    assert ecat("project", "new", session).code == 1
    assert ecat("project", "new", session / "inside").code == 1
    assert not (session / "inside").exists()


def test_a_session_is_put_away_and_brought_back_or_deleted(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    project = tmp_path / "project"
    ecat("project", "new", project)
    for name in ("one", "two"):
        shutil.copytree(session, project / name)
    name = ecat("project", "remove", project, project / "one", "--json").json["archived"]
    assert ecat("info", project, "--json").json["totals"]["sessions"] == 1
    assert name in ecat("project", "archive", project).out
    assert ecat("project", "restore", project, name).out.strip().endswith("one is back")
    assert ecat("project", "archive", project).out.strip() == "the archive is empty"
    assert ecat("project", "remove", project, project / "two", "--for-good").out.startswith("deleted")
    assert not (project / "two").exists()
    name = ecat("project", "remove", project, project / "one", "--json").json["archived"]
    assert ecat("project", "restore", project, name, "--delete", "two").code == 2
    assert ecat("project", "restore", project, name, "--delete", "one").code == 0
    assert not (project / ".archive").exists()
    assert ecat("project", "remove", project, project / "one").code == 1
