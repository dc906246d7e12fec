"""What goes wrong becomes one message and an exit code."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest

from ecat.cli.output import Output
from ecat.cli.verb import verb
from ecat.errors import FormatError

if TYPE_CHECKING:
    from conftest import Ecat

Install = Callable[[Callable[[], object]], None]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Make the verb ``formats`` do something else."""

    def make(work: Callable[[], object]) -> None:
        def run(out: Output) -> int:
            work()
            return 0

        from ecat.cli import formats

        monkeypatch.setattr(formats, "command", verb("formats", examples=())(run))

    return make


def test_bad_input_is_said_in_four_lines(ecat: Ecat, install: Install) -> None:
    def work() -> None:
        raise FormatError(
            "cannot import Session1/files.param",
            where="line 48213: expected 25 cells in <code>, found 24",
            consequence="nothing was written to out/",
            fix="ecat import --skip-bad-markers ...",
        )

    install(work)
    result = ecat("formats")
    assert (result.code, result.out) == (1, "")
    assert result.err == (
        "ecat: cannot import Session1/files.param\n"
        "  line 48213: expected 25 cells in <code>, found 24\n"
        "  nothing was written to out/\n"
        "  try: ecat import --skip-bad-markers ...\n"
    )


def test_with_json_the_error_is_a_document(ecat: Ecat, install: Install) -> None:
    def work() -> None:
        raise FormatError("cannot import it", where="line 7", consequence="nothing was written", fix="again")

    install(work)
    result = ecat("formats", "--json")
    assert (result.code, result.err) == (1, "")
    assert result.json == {
        "ok": False,
        "error": {
            "error": "FormatError",
            "what": "cannot import it",
            "where": "line 7",
            "consequence": "nothing was written",
            "fix": "again",
        },
    }


@pytest.mark.parametrize(
    ("args", "what", "fix"),
    [
        (["infos"], "no such command 'infos'", "ecat --help"),
        (["info"], "missing argument 'PATH'", "ecat info --help"),
        (["info", "x", "--jsn"], "no such option '--jsn'", "ecat info --help"),
        (["sample", "x", "--seed", "-1"], "invalid value for '--seed'", "ecat sample --help"),
    ],
)
def test_wrong_usage_is_exit_code_2(ecat: Ecat, args: list[str], what: str, fix: str) -> None:
    result = ecat(*args)
    assert result.code == 2
    assert result.err.startswith(f"ecat: {what}")
    assert result.err.endswith(f"  nothing was done\n  try: {fix}\n")


@pytest.mark.parametrize("args", [["--json", "formats"], ["-q", "--json", "formats"], ["formats", "--json"]])
def test_what_every_verb_takes_may_stand_before_the_verb(ecat: Ecat, args: list[str]) -> None:
    result = ecat(*args)
    assert (result.code, result.json["ok"]) == (0, True)


def test_an_option_without_a_verb_is_wrong_usage(ecat: Ecat) -> None:
    assert ecat("--quiet").err.startswith("ecat: missing verb after --quiet\n  Usage: ecat [OPTIONS] COMMAND")


def test_a_mistyped_verb_is_recognised(ecat: Ecat) -> None:
    assert "'info'" in ecat("infos").err


def test_wrong_usage_as_json(ecat: Ecat) -> None:
    result = ecat("info", "--json")
    assert (result.code, result.json["ok"], result.json["error"]["error"]) == (2, False, "UsageError")


def test_a_bug_is_exit_code_3_with_a_traceback_and_where_to_report_it(ecat: Ecat, install: Install) -> None:
    install(lambda: 1 // 0)
    result = ecat("formats")
    assert (result.code, result.out) == (3, "")
    assert result.err.startswith("Traceback")
    assert "ecat: this is a bug in ecat: ZeroDivisionError\n" in result.err
    assert "report it" in result.err


def test_a_bug_as_json_keeps_stdout_a_document(ecat: Ecat, install: Install) -> None:
    install(lambda: 1 // 0)
    result = ecat("formats", "--json")
    assert (result.code, result.json["ok"]) == (3, False)
    assert result.err.startswith("Traceback")


def test_an_error_of_the_system_is_no_bug(ecat: Ecat, install: Install) -> None:
    def work() -> None:
        raise OSError(28, "No space left on device", "out")

    install(work)
    result = ecat("formats")
    assert result.code == 1
    assert "No space left on device" in result.err
    assert "Traceback" not in result.err


def test_ctrl_c_is_exit_code_130_and_one_line(ecat: Ecat, install: Install) -> None:
    def work() -> None:
        raise KeyboardInterrupt

    install(work)
    result = ecat("formats")
    assert (result.code, result.out) == (130, "")
    assert result.err.strip() == "ecat: interrupted"


def start(program: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", program]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_signal_ends_it_cleanly() -> None:
    program = (
        "import sys, time\n"
        "from ecat.cli import formats, main\n"
        "from ecat.cli.verb import verb\n"
        "def run(out):\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(30)\n"
        "formats.command = verb('formats', examples=())(run)\n"
        "sys.exit(main(['formats']))\n"
    )
    with start(program) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert err.strip() == "ecat: interrupted"


def test_a_reader_that_goes_away_is_no_error() -> None:
    program = (
        "import sys\n"
        "from ecat.cli import formats, main\n"
        "from ecat.cli.verb import verb\n"
        "def run(out):\n"
        "    for _ in range(100_000):\n"
        "        out.say('a line of the result')\n"
        "formats.command = verb('formats', examples=())(run)\n"
        "sys.exit(main(['formats']))\n"
    )
    with start(program) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        err = process.stderr.read()
    assert (process.wait(timeout=20), err) == (141, "")


def test_names_cannot_steer_the_terminal(ecat: Ecat, install: Install) -> None:
    def work() -> None:
        raise FormatError("cannot import \x1b[2J.avi")

    install(work)
    assert ecat("formats").err.splitlines()[0] == "ecat: cannot import \\x1b[2J.avi"


def test_a_line_feed_in_a_name_does_not_make_a_line(ecat: Ecat, tmp_path: Path) -> None:
    lines = ecat("info", tmp_path / "a\nb").err.splitlines()
    assert lines[0] == "ecat: cannot find sessions in a\\nb"
    assert len(lines) == 4


class FakePoint:
    """An entry point of another package."""

    def __init__(self, name: str, command: click.Command | None) -> None:
        self.name, self.value, self._command = name, f"other.{name}:command", command

    def load(self) -> click.Command:
        if self._command is None:
            raise ImportError("No module named 'torch'")
        return self._command


@pytest.fixture
def plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    @click.command("learn", help="Learn from recordings.")
    def learn() -> int:
        return 7

    points = [FakePoint("learn", learn), FakePoint("broken", None), FakePoint("info", learn)]
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda *, group: points if group == "ecat.cli" else []
    )


@pytest.mark.usefixtures("plugins")
def test_other_packages_add_verbs(ecat: Ecat) -> None:
    assert "Learn from recordings." in ecat("--help").out
    assert ecat("learn").code == 7


@pytest.mark.usefixtures("plugins")
def test_other_packages_cannot_replace_a_verb(ecat: Ecat) -> None:
    assert ecat("info", "--help").out.startswith("Usage: ecat info [OPTIONS] PATH")


@pytest.mark.usefixtures("plugins")
def test_a_verb_that_cannot_be_loaded_says_what_is_missing(ecat: Ecat) -> None:
    assert "not installed" in ecat("--help").out
    result = ecat("broken", "train", "--fast")
    assert result.code == 1
    assert "cannot load the verb broken" in result.err
    assert "No module named 'torch'" in result.err
