"""Every verb can be found, understood and copied from its help."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest

from ecat.cli.app import VERBS, app
from ecat.cli.reference import page_of, reference, with_formats
from ecat.cli.verb import Group, Verb, leaves
from ecat.formats import registry

if TYPE_CHECKING:
    from conftest import Ecat

REFERENCE = Path(__file__).parents[2] / "docs" / "cli.md"


def commands() -> dict[str, Verb | Group]:
    """All verbs, and those of groups, by what is typed after ``ecat``."""
    found: dict[str, Verb | Group] = {}
    for name in app.list_commands(click.Context(app)):
        command = app.get_command(click.Context(app), name)
        assert command is not None
        found |= {" ".join(path): inner for path, inner in leaves(command, (name,))}
    return found


COMMANDS = commands()
CALLED = {name: command for name, command in COMMANDS.items() if isinstance(command, Verb)}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_verb_says_what_it_does_and_what_its_parameters_mean(name: str) -> None:
    command = COMMANDS[name]
    assert command.help
    assert command.get_short_help_str()
    undocumented = [p.name for p in command.params if not getattr(p, "help", None)]
    assert undocumented == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_verb_has_examples_that_it_accepts(name: str) -> None:
    command = COMMANDS[name]
    assert command.examples
    for example in command.examples:
        program, *words = shlex.split(example)
        assert program == "ecat"
        assert words[: len(name.split())] == name.split()
        called = next(
            key for key in sorted(CALLED, key=len, reverse=True) if words[: len(key.split())] == key.split()
        )
        # raises if an option is unknown or an argument is missing
        CALLED[called].make_context(called, words[len(called.split()) :])


@pytest.mark.parametrize("name", CALLED)
def test_every_verb_prints_json_and_can_be_quiet(name: str) -> None:
    options = {option for parameter in CALLED[name].params for option in parameter.opts}
    assert {"--json", "--quiet"} <= options


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_verb_shows_its_examples(ecat: Ecat, name: str) -> None:
    result = ecat(*name.split(), "--help")
    assert result.code == 0
    assert all(example in result.out for example in COMMANDS[name].examples)


def test_the_verbs_are_listed_in_the_order_of_their_use(ecat: Ecat) -> None:
    lines = ecat("--help").out.partition("Commands:")[2].splitlines()
    assert [line.split()[0] for line in lines[1 : 1 + len(VERBS)]] == list(VERBS)


def test_without_arguments_the_help_is_shown(ecat: Ecat) -> None:
    assert ecat() == ecat("--help")


def test_the_reference_is_up_to_date() -> None:
    assert REFERENCE.read_text("utf-8") == reference(), "make docs"


def test_every_verb_has_its_section_in_the_reference() -> None:
    sections = {line[3:] for line in REFERENCE.read_text("utf-8").splitlines() if line.startswith("## ")}
    assert sections == {"ecat", *(f"ecat {name}" for name in COMMANDS)}


def test_help_imports_nothing_heavy() -> None:
    heavy = "cv2 lxml numpy pandas pyarrow pydantic rerun rich scipy"
    program = (
        "import sys; from ecat.cli import main; main(['--help']); "
        f"print(*sorted(set({heavy.split()}) & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == ""


def test_the_formats_of_the_readme_are_those_of_the_registry_and_each_has_a_page() -> None:
    readme = REFERENCE.parents[1] / "README.md"
    text = readme.read_text("utf-8")
    assert with_formats(text, readme.parent / "docs" / "formats") == text, "make docs writes it anew"
    assert text.count("\n| [") == len(registry.all_formats())


def test_a_format_without_a_page_is_told() -> None:
    pages = {"a.md": "# Data: parquet, torch\n", "b.md": "| `csv` | yes |\n"}
    assert [page_of(name, pages) for name in ("torch", "parquet", "csv")] == ["a.md", "a.md", "b.md"]
    for name in ("tor", "quet", "sv"):
        with pytest.raises(LookupError, match=name):
            page_of(name, pages)
