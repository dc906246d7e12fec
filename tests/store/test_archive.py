"""Sessions are put away, listed, brought back, and deleted when that is confirmed."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecat.errors import ConflictError, LockedError, NotFoundError, UsageError
from ecat.store import archive, find_sessions, open_session
from ecat.store.lock import locked
from tests.store.sessions import make


@pytest.fixture
def project(tmp_path: Path) -> Path:
    for name in ("a/one", "two"):
        make(tmp_path / "p" / name, 3)
    return tmp_path / "p"


def files_of(folder: Path) -> dict[str, bytes]:
    paths = (p for p in folder.rglob("*") if p.is_file() and p.name != "session.lock")
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in paths}


def test_what_is_put_away_comes_back_as_it_was(project: Path) -> None:
    before = files_of(project)
    name = archive.put_away(project, project / "a" / "one")
    assert [p.name for p in find_sessions(project)] == ["two"]
    (found,) = archive.archived(project)
    assert (found.id, found.place, found.name) == (name, Path("a/one"), "one")
    assert found.when.endswith("+00:00")
    assert archive.bring_back(project, name) == project / "a" / "one"
    assert files_of(project) == before
    assert archive.archived(project) == []
    assert open_session(project / "a" / "one").manifest.revision == 1


def test_the_newest_is_listed_first_and_what_is_not_ours_is_left_alone(project: Path) -> None:
    for session in ("two", "a/one"):
        archive.put_away(project, project / session)
    (project / ".archive" / "20200101T000000-0a0a0a").mkdir()
    (project / ".archive" / "20209999T999999-0a0a0a" / "x").mkdir(parents=True)
    make(project / ".archive" / "mine" / "three")
    stamps = [one.id for one in archive.archived(project)]
    assert len(stamps) == 2
    assert stamps == sorted(stamps, reverse=True)


def test_for_good_is_only_by_its_name(project: Path) -> None:
    name = archive.put_away(project, project / "two")
    with pytest.raises(UsageError, match="it is called two, not Two"):
        archive.delete(project, name, "Two")
    archive.delete(project, name, "two")
    assert not (project / ".archive").exists()
    with pytest.raises(NotFoundError):
        archive.delete(project, name, "two")


def test_what_took_the_place_stays(project: Path) -> None:
    name = archive.put_away(project, project / "two")
    make(project / "two", 5)
    with pytest.raises(ConflictError):
        archive.bring_back(project, name)
    assert [one.id for one in archive.archived(project)] == [name]


@pytest.mark.parametrize("name", ["", "..", "../../etc", "20200101T000000-0a0a0a"])
def test_a_name_that_is_not_in_the_archive_is_refused(project: Path, name: str) -> None:
    archive.put_away(project, project / "two")
    with pytest.raises(NotFoundError):
        archive.bring_back(project, name)


def test_only_sessions_of_the_folder_and_while_nobody_writes(project: Path, tmp_path: Path) -> None:
    make(tmp_path / "elsewhere")
    for path in (tmp_path / "elsewhere", project):
        with pytest.raises(UsageError):
            archive.put_away(project, path)
    with locked(project / "two", wait_s=1), pytest.raises(LockedError):
        archive.put_away(project, project / "two")
    assert (project / "two").is_dir()
