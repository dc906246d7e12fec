"""What ``--repair`` does about tables that stages made."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import pytest

from ecat.check import check, repair
from ecat.errors import EcatError
from ecat.process import process_session
from ecat.sample import sample_session
from ecat.store import TableData, create_session, open_session


@pytest.fixture(scope="module")
def processed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sample session with all tables that stages make."""
    path = tmp_path_factory.mktemp("processed") / "session"
    create_session(path, sample_session(seed=1, actions=("next",))[0])
    process_session(path, smooth=True)
    return path


@pytest.fixture
def session(processed: Path, tmp_path: Path) -> Path:
    return copytree(processed, tmp_path / "session")


def codes(path: Path, *, deep: bool = False) -> set[str]:
    return {finding.code for finding in check(path, deep=deep)} - {"clock-unknown"}


def hashes(path: Path) -> dict[str, str]:
    return {record.name: record.sha256 for record in open_session(path).manifest.tables}


@pytest.mark.parametrize("content", [None, b"PAR1", b""], ids=["gone", "cut", "empty"])
@pytest.mark.parametrize(
    "names", [["table_plane"], ["poses"], ["poses_smooth"], ["table_plane", "poses", "poses_smooth"]]
)
def test_damaged_tables_are_made_again_with_the_same_bytes(
    session: Path, names: list[str], content: bytes | None
) -> None:
    before = hashes(session)
    for name in names:
        file = session / "tables" / f"{name}.parquet"
        file.unlink() if content is None else file.write_bytes(content)
    repairs = repair(session, check(session))
    assert [finding.place for finding in repairs.done] == [f"table {name}" for name in sorted(names)]
    assert codes(session, deep=True) == set()
    assert hashes(session) == before


def test_damage_in_the_middle_of_a_table_is_mended_too(session: Path) -> None:
    file = session / "tables/poses.parquet"
    data = bytearray(file.read_bytes())
    data[2000] ^= 0xFF
    file.write_bytes(bytes(data))
    repair(session, check(session, deep=True))
    assert codes(session, deep=True) == set()


def test_stale_tables_and_what_follows_from_them_are_made_again(session: Path) -> None:
    opened = open_session(session)
    marks = opened.table("markers_2d").to_arrow()
    with opened.write() as commit:
        commit.put_table("markers_2d", TableData(data=marks.slice(0, marks.num_rows - 40)))
    before = hashes(session)
    assert codes(session) == {"table-stale"}
    assert repair(session, check(session)).failed == []
    assert codes(session) == set()
    after = hashes(session)
    assert all(after[name] != before[name] for name in ("poses", "poses_smooth"))


def test_nothing_is_made_that_was_not_there(session: Path, tmp_path: Path) -> None:
    path = tmp_path / "plane_only"
    create_session(path, sample_session(seed=1, actions=("next",))[0])
    process_session(path, stages=["plane"])
    (path / "tables/table_plane.parquet").unlink()
    repair(path, check(path))
    assert not open_session(path).has_table("poses")
    assert codes(path) == set()


def test_what_cannot_be_repaired_is_said_and_does_not_stop_the_rest(session: Path) -> None:
    project = session.parent
    copytree(session, project / "sound")
    (project / "sound" / "tables/poses.parquet").unlink()
    (session / "tables/poses.parquet").unlink()
    (session / "tables/markers_2d.parquet").unlink()
    repairs = repair(project, check(project))
    ((finding, reason),) = repairs.failed
    assert (finding.session, finding.place) == ("session", "table poses")
    assert isinstance(reason, EcatError)
    assert [finding.session for finding in repairs.done] == ["sound"]
    assert {(f.session, f.place) for f in check(project) if f.severity == "error"} == {
        ("session", "table markers_2d"),
        ("session", "table poses"),
    }


def test_a_table_whose_stage_does_not_apply_any_more_is_left_as_it_is(session: Path) -> None:
    opened = open_session(session)
    with opened.write() as commit:
        for name in ("markers_2d", "markers_3d"):
            commit.put_table(name, TableData(data=opened.table(name).to_arrow().slice(0, 0)))
    (session / "tables/poses.parquet").unlink()
    ((_, reason), *_) = repair(session, check(session)).failed
    assert reason.where == "no markers in this session"
