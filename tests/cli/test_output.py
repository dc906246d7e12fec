"""Results on stdout, progress on stderr, and no more of either than was asked for."""

from __future__ import annotations

import pytest

from ecat.cli import output
from ecat.cli.output import Output, printable


class Clock:
    """Seconds that pass when they are told to."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(output.time, "monotonic", made)
    return made


Captured = pytest.CaptureFixture[str]


def test_short_work_says_nothing(clock: Clock, capsys: Captured) -> None:
    with Output().progress() as progress:
        for i in range(100):
            clock.now_s += 0.009
            progress("poses", i, 100)
    assert capsys.readouterr() == ("", "")


def test_long_work_says_at_most_a_line_per_tenth(clock: Clock, capsys: Captured) -> None:
    with Output().progress() as progress:
        for i in range(1001):
            clock.now_s += 3.6
            progress("poses", i, 1000)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "poses: 100 of 1,000 (10%)"
    assert lines[-1] == "poses: 1,000 of 1,000 (100%)"
    assert len(lines) == 10


def test_work_of_unknown_length_says_at_most_a_line_per_second(clock: Clock, capsys: Captured) -> None:
    with Output().progress() as progress:
        for i in range(40):
            clock.now_s += 0.25
            progress("reading", i, 0)
    lines = capsys.readouterr().err.splitlines()
    assert (len(lines), lines[0]) == (10, "reading: 3")


def test_the_next_stage_starts_anew(clock: Clock, capsys: Captured) -> None:
    with Output().progress() as progress:
        for what in ("plane", "poses"):
            for i in range(11):
                clock.now_s += 2
                progress(what, i, 10)
    assert capsys.readouterr().err.count("poses: ") == 11


def test_quiet_work_says_nothing(clock: Clock, capsys: Captured) -> None:
    with Output(quiet=True).progress() as progress:
        clock.now_s += 60
        progress("poses", 1, 2)
    assert capsys.readouterr() == ("", "")


def test_a_terminal_gets_a_bar(monkeypatch: pytest.MonkeyPatch, capsys: Captured) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Output().progress() as progress:
        progress("poses [of boxes]", 1, 2)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (Output(), "two boxes\n"),
        (Output(quiet=True), ""),
        (Output(as_json=True), '{\n  "ok": true,\n  "boxes": 2\n}\n'),
        (Output(as_json=True, quiet=True), '{\n  "ok": true,\n  "boxes": 2\n}\n'),
    ],
)
def test_results_are_text_or_json_or_nothing(made: Output, expected: str, capsys: Captured) -> None:
    made.result({"boxes": 2}, "two boxes")
    assert capsys.readouterr().out == expected


def test_json_never_holds_what_is_not_json(capsys: Captured) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        Output(as_json=True).result({"duration_s": float("nan")}, "")


@pytest.mark.parametrize(
    ("text", "shown"),
    [("Größe 箱", "Größe 箱"), ("a\nb", "a\nb"), ("\x1b[2J", "\\x1b[2J"), ("\x7f\r", "\\x7f\\r")],
)
def test_control_characters_are_shown_as_escapes(text: str, shown: str) -> None:
    assert printable(text) == shown
