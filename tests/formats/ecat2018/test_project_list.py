"""The list of sessions of a project, with its stale and repeated names."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import EcatError, FormatError, LimitError, UsageError
from ecat.formats.ecat2018 import project_list
from ecat.formats.ecat2018.project_list import ProjectList, findings, read_project_list, write_project_list

names = st.text(st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\ufeff"), min_size=1)


def test_real_lists_come_back_byte_for_byte(shared: Path) -> None:
    paths = list((shared / "ecat_movies").rglob("*.project"))
    assert len(paths) == 24
    for path in paths:
        assert write_project_list(read_project_list(path)) == path.read_bytes()


@given(st.lists(names).map(tuple), st.sampled_from(["\n", "\r\n"]))
def test_reading_a_written_list_gives_its_names(listed: tuple[str, ...], newline: str) -> None:
    projects = ProjectList(listed, "\r\n" if newline == "\r\n" else "\n")
    assert read_project_list(write_project_list(projects)).names == listed


@pytest.mark.parametrize("data", [b"", b"a", b"a\n", b"a\n\nb", b"a\r\nb\r\n", b"a\r\nb", b"\n", b"a\nb\n"])
def test_line_ends_and_the_last_of_them_are_kept(data: bytes) -> None:
    assert write_project_list(read_project_list(data)) == data


@given(st.binary(max_size=60))
def test_any_bytes_give_a_list_or_one_typed_error(data: bytes) -> None:
    with suppress(EcatError):
        assert "\x00" not in "".join(read_project_list(data).names)


def test_binary_files_are_refused() -> None:
    with pytest.raises(FormatError, match="byte 1: not UTF-8"):
        read_project_list(b"a\xff")
    with pytest.raises(FormatError, match="NUL"):
        read_project_list(b"a\x00b")


def test_a_list_too_long_is_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(project_list, "MAX_BYTES", 10)
    with pytest.raises(LimitError):
        read_project_list(b"x" * 11)


def test_a_name_with_a_line_end_is_not_written() -> None:
    with pytest.raises(UsageError):
        write_project_list(ProjectList(("a\nb",), "\n"))


def test_repeated_stale_and_unlisted_names_are_told() -> None:
    projects = ProjectList(("Session1", "Session2", "Session1"))
    assert findings(projects, ["Session1", "Session3"]) == (
        "'Session1' is listed 2 times",
        "'Session2' is listed but has no folder",
        "'Session3' has a folder but no line",
    )


def test_the_stale_list_of_the_movies_is_told(shared: Path) -> None:
    """Trap: a project folder may hold a second list that lacks sessions and repeats a line."""
    folder = shared / "ecat_movies" / "Annotation" / "VanLuanMovieWorkspace" / "0009_Forrest_Gump"
    stale = read_project_list(folder / "Forrest_Gump.project")
    complete = read_project_list(folder / "0009_Forrest_Gump.project")
    told = findings(stale, complete.names)
    assert sum(line.endswith("listed 2 times") for line in told) == 1
    assert sum(line.endswith("has a folder but no line") for line in told) == 454
    assert not stale.final_newline


def test_ecat_showed_a_session_whose_name_is_part_of_a_line() -> None:
    """Trap: names were compared as substrings."""
    projects = ProjectList(("Session10",))
    assert projects.shows("Session1")
    assert not projects.shows("Session2")
