"""Two streams are never one in a data set."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecat import formats
from ecat.errors import InputError
from tests.formats.datasets.moments import Make, Span, maker

SPAN = Span(10, 45)
LOST = [
    ("torch", "a/b", "a_b"),
    ("webdataset", "a/b", "a_b"),
    ("webdataset", "a.b", "a/b"),
    ("rlds", "a/b", "a_b"),
    ("rlds", "a-b", "a_b"),
    ("rlds", "a", "a_known"),
    ("lerobot", "a/b", "a_b"),
]
"""A format, and names that are one there."""


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Make sessions of a project."""
    return maker(tmp_path / "project")


def option_of(name: str) -> str:
    return "cameras" if name == "lerobot" else "streams"


@pytest.mark.parametrize(("name", "first", "second"), LOST)
def test_streams_of_a_session_that_would_have_one_name_are_refused(
    make: Make, tmp_path: Path, name: str, first: str, second: str
) -> None:
    session = make("one", SPAN, film=True, streams=(first, second))
    with pytest.raises(InputError, match=f"cannot tell stream {second} from stream {first}") as raised:
        formats.export(session, tmp_path / "out", format=name)
    option = option_of(name)
    assert f"--option {option}=" in raised.value.fix
    assert not (tmp_path / "out").exists()
    formats.export(session, tmp_path / "out", format=name, options={option: first})


@pytest.mark.parametrize(("name", "first", "second"), LOST)
def test_so_are_streams_of_different_sessions(
    make: Make, tmp_path: Path, name: str, first: str, second: str
) -> None:
    make("one", SPAN, film=True, streams=(first,))
    make("two", SPAN, film=True, streams=(second,))
    with pytest.raises(InputError, match=f"cannot tell stream {second} from stream {first}"):
        formats.export(tmp_path / "project", tmp_path / "out", format=name)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("stream", ["state", "state_known"])
def test_no_stream_of_rlds_takes_the_place_of_the_state(make: Make, tmp_path: Path, stream: str) -> None:
    session = make("one", SPAN, film=True, streams=(stream, "color"))
    with pytest.raises(
        InputError, match=f"cannot tell stream {stream} from what the data set itself"
    ) as raised:
        formats.export(session, tmp_path / "out", format="rlds")
    assert f"called {stream}" in raised.value.where
    formats.export(session, tmp_path / "out", format="rlds", options={"streams": "color"})


@pytest.mark.parametrize("name", ["torch", "webdataset", "lerobot"])
def test_where_names_stay_unlike_all_streams_are_written(make: Make, tmp_path: Path, name: str) -> None:
    session = make("one", SPAN, film=True, streams=("a/b", "a-b", "state", "color"))
    report = formats.export(session, tmp_path / "out", format=name)
    assert not any("left behind" in finding for finding in report.findings)
