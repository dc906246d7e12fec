"""Every error says what, where, what became of the data, and what to do."""

from __future__ import annotations

import ast
import errno
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat import errors
from ecat.errors import DiskError, EcatError, FormatError, ReadOnlyError, SchemaError, os_error

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted(
    str(path.relative_to(ROOT)) for package in ("ecat", "learn") for path in (ROOT / package).rglob("*.py")
)
KINDS = {
    name: kind
    for name, kind in vars(errors).items()
    if isinstance(kind, type) and issubclass(kind, EcatError)
}
SPEAKS_FOR_ITSELF = {"interrupted"}
"""Who pressed Ctrl-C knows where and why."""


def made_in(path: Path) -> Iterator[tuple[ast.Call, type[EcatError]]]:
    """Every error that is made in a module, with its class."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in KINDS:
            yield node, KINDS[node.func.id]


def left_out(call: ast.Call, kind: type[EcatError]) -> set[str]:
    """What the call says neither itself nor by the default of its class."""
    said = {keyword.arg for keyword in call.keywords if ast.unparse(keyword.value) not in {"''", '""'}}
    if kind is SchemaError and "problems" in said:
        said.add("where")
    usual = {"consequence": kind.usual_consequence, "fix": kind.usual_fix}
    said |= {name for name, text in usual.items() if text}
    return {"where", "consequence", "fix"} - said


@pytest.mark.parametrize("path", SOURCES)
def test_no_error_leaves_out_where_it_is_what_became_of_the_data_or_what_to_do(path: str) -> None:
    found = {
        f"line {call.lineno}: {kind.__name__}": missing
        for call, kind in made_in(ROOT / path)
        if (missing := left_out(call, kind))
        and not (isinstance(call.args[0], ast.Constant) and call.args[0].value in SPEAKS_FOR_ITSELF)
    }
    assert found == {}


def test_the_check_sees_what_is_left_out() -> None:
    (call,) = (node for node in ast.walk(ast.parse("FormatError('x', fix='')")) if isinstance(node, ast.Call))
    assert left_out(call, FormatError) == {"where"}
    assert left_out(call, DiskError) == {"where", "consequence", "fix"}


@given(st.text(), st.text(), st.text(), st.text())
def test_an_error_has_a_line_for_each_whatever_the_names_in_it(
    what: str, where: str, data: str, fix: str
) -> None:
    lines = str(DiskError(what, where=where, consequence=data, fix=fix)).split("\n")
    assert len(lines) == 1 + sum(map(bool, (where, data, fix)))
    assert all(line.isprintable() for line in lines)


def test_several_places_have_a_line_each() -> None:
    made = FormatError("cannot import w", where=("S1: line 7", "S\n2: line 9"))
    assert str(made).split("\n")[1:3] == ["  S1: line 7", "  S\\n2: line 9"]


@pytest.mark.parametrize("number", [getattr(errno, name) for name in dir(errno) if name.startswith("E")])
def test_every_error_of_the_system_says_what_to_do(number: int) -> None:
    made = os_error(OSError(number, "no"), "cannot read x", "x")
    assert (made.where, made.consequence, bool(made.fix)) == ("x: no", "it was not read", True)


def test_a_name_that_is_too_long_does_not_fill_the_disk() -> None:
    assert os_error(OSError(errno.ENAMETOOLONG, "File name too long"), "", "x").fix == "use a shorter name"


def test_a_disk_that_is_mounted_read_only_is_not_broken() -> None:
    made = os_error(OSError(errno.EROFS, "Read-only file system"), "cannot create s", "s")
    assert isinstance(made, ReadOnlyError)
    assert made.fix == "choose a destination on a disk that may be written to"


def test_a_file_too_large_for_its_disk_does_not_mean_that_the_disk_is_broken() -> None:
    fix = os_error(OSError(errno.EFBIG, "File too large"), "cannot write x", "x").fix
    assert "files of that size" in fix
    assert "ulimit" in fix
