"""Projects and workspaces are folders of sessions."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecat.errors import ExistsError, FormatError, NotFoundError
from ecat.model import ProjectManifest
from ecat.store import create_project, create_session, find_sessions, open_project, staged_folder
from ecat.store.project import write_project_manifest
from tests.store.sessions import draft, make

PROJECT = ProjectManifest(name="project", created="2020-01-01T00:00:00")
WORKSPACE = ProjectManifest(name="workspace", created="2020-01-01T00:00:00", kind="workspace")


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A workspace of two projects; one has two sessions, the other none."""
    create_project(tmp_path / "w", WORKSPACE)
    for name in ("b", "a"):
        create_project(tmp_path / "w" / name, PROJECT)
    for number, name in enumerate(("s2", "s1")):
        make(tmp_path / "w" / "b" / name, number)
    return tmp_path / "w"


def test_sessions_are_found_at_any_depth_in_the_order_of_their_paths(workspace: Path) -> None:
    wanted = [workspace / "b" / "s1", workspace / "b" / "s2"]
    assert find_sessions(workspace) == wanted
    assert find_sessions(workspace / "b") == wanted
    assert find_sessions(workspace / "b" / "s2") == [workspace / "b" / "s2"]
    assert find_sessions(workspace / "a") == []
    project = open_project(workspace)
    assert project.manifest == WORKSPACE
    assert project.session_paths() == wanted
    assert [session.path for session in project.sessions()] == wanted
    assert [child.path.name for child in project.children()] == ["a", "b"]
    assert open_project(workspace / "b").children() == []


def test_unfinished_folders_hidden_ones_and_links_are_passed_over(workspace: Path) -> None:
    make(workspace / ".hidden")
    (workspace / "b" / "again").symlink_to(workspace)
    (workspace / "b" / "s1" / "media").mkdir()
    make(workspace.parent / "nested").path.rename(workspace / "b" / "s1" / "media" / "nested")
    assert find_sessions(workspace) == [workspace / "b" / "s1", workspace / "b" / "s2"]


def test_a_plain_folder_of_sessions_will_do(tmp_path: Path) -> None:
    make(tmp_path / "x" / "s")
    assert find_sessions(tmp_path) == [tmp_path / "x" / "s"]


@pytest.mark.parametrize("name", ["gone", "file", "empty", "a\0b"])
def test_where_there_is_nothing_that_is_said(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    with pytest.raises(NotFoundError, match="cannot find sessions"):
        find_sessions(tmp_path / name)
    with pytest.raises(NotFoundError, match="cannot open project"):
        open_project(tmp_path / name)


def test_a_project_with_its_sessions_can_appear_at_once(tmp_path: Path) -> None:
    with staged_folder(tmp_path / "p") as staging:
        write_project_manifest(staging, PROJECT)
        create_session(staging / "s", draft())
        assert not (tmp_path / "p").exists()
    assert find_sessions(tmp_path / "p") == [tmp_path / "p" / "s"]
    assert list(tmp_path.iterdir()) == [tmp_path / "p"]


def test_an_occupied_destination_and_a_damaged_manifest(workspace: Path) -> None:
    with pytest.raises(ExistsError):
        create_project(workspace, PROJECT)
    (workspace / "project.json").write_text("{")
    with pytest.raises(FormatError, match=r"project\.json"):
        open_project(workspace)
    assert len(find_sessions(workspace)) == 2
