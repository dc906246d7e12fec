"""What holds for the project as a whole: its dependencies, its start-up, its documents, its shape."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted(path for top in ("ecat", "learn") for path in (ROOT / top).rglob("*.py"))
OTHERS = sorted(path for top in ("tests", "benchmarks") for path in (ROOT / top).rglob("*.py"))
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])

MAX_MODULE_LINES = 440
MAX_FUNCTION_LINES = 60

NEVER_AT_IMPORT = {"duckdb", "matplotlib", "open3d", "ray", "rerun", "torch"}
FOR_LEARNING = {"ecat/datasets/windows.py"} | {
    str(path.relative_to(ROOT)) for path in (ROOT / "learn/recognize/neural").glob("[a-z]*.py")
}
"""Modules that are of no use without PyTorch, and are imported by name."""
PARTS = {"pydantic_core": "pydantic"}
"""Packages that another one pins exactly and documents as its own."""
NOT_AT_START = NEVER_AT_IMPORT | {"cv2", "fastapi", "pandas", "scipy", "uvicorn"}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def distribution(requirement: str) -> str:
    """``pyright[nodejs]==1.1`` is the distribution ``pyright``."""
    match = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert match, requirement
    return match[0].lower()


def declared(*extras: str) -> set[str]:
    """The distributions that the core and ``extras`` ask for."""
    table = project()["project"]
    groups = [table["dependencies"], *(table["optional-dependencies"][extra] for extra in extras)]
    return {distribution(line) for group in groups for line in group} - {"ecat"}


# --- dependencies


def test_every_dependency_is_explained_and_no_explanation_outlives_its_dependency() -> None:
    text = (ROOT / "docs" / "dependencies.md").read_text("utf-8")
    explained = set(re.findall(r"^- \*\*([a-z0-9-]+)\*\*", text, flags=re.MULTILINE))
    build = {distribution(line) for line in project()["build-system"]["requires"]}
    assert explained == declared(*project()["project"]["optional-dependencies"]) | build


def test_every_dependency_has_a_lower_and_an_upper_bound() -> None:
    table = project()["project"]
    extras = [line for lines in table["optional-dependencies"].values() for line in lines]
    lines = [line for line in (*table["dependencies"], *extras) if not line.startswith("ecat[")]
    assert [line for line in lines if not re.search(r"==|>=.*,<", line)] == []


@pytest.mark.parametrize("package", ["ecat", "learn"])
def test_imports_only_what_it_declares(package: str) -> None:
    distributions = importlib.metadata.packages_distributions()
    extras = set(project()["project"]["optional-dependencies"]) - {"dev", "test"}
    for_ecat, for_learn = declared(*extras - {"learn"}), declared(*extras)
    undeclared = {
        f"{name_of(path)} imports {top}"
        for path in (ROOT / package).rglob("*.py")
        for top in imported_packages(path)
        if top not in sys.stdlib_module_names and top not in {"ecat", "learn"}
        for allowed in (for_ecat if package == "ecat" and name_of(path) not in FOR_LEARNING else for_learn,)
        if not {name.lower() for name in distributions.get(PARTS.get(top, top), [top])} & allowed
    }
    assert undeclared == set()


def imported_packages(path: Path) -> Iterator[str]:
    """Top-level packages that the module imports, at import or later."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module.partition(".")[0]


def test_the_source_distribution_has_every_folder_of_the_checkout() -> None:
    packed = project()["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    there = {
        path.relative_to(ROOT).parts[0] for path in [*SOURCES, *OTHERS, *DOCUMENTS] if path.parent != ROOT
    }
    assert there | {"schemas", "sample_sessions"} <= {name.strip("/") for name in packed}


def test_every_entry_point_leads_somewhere() -> None:
    table = project()["project"]
    for target in table["scripts"].values():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function)), target
    for module in table["entry-points"]["ecat.formats"].values():
        assert importlib.import_module(module.partition(":")[0]).__doc__, module


# --- start-up


def loaded_by(statements: str) -> set[str]:
    """The top-level packages that a fresh interpreter holds after ``statements``."""
    code = f"import sys\n{statements}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_the_command_line_starts_without_heavy_libraries() -> None:
    loaded = loaded_by("import ecat, ecat.cli")
    assert "ecat" in loaded
    assert loaded & NOT_AT_START == set()


def test_no_module_loads_the_heaviest_libraries_before_it_needs_them() -> None:
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in SOURCES]
    later = {".".join(Path(name).with_suffix("").parts) for name in FOR_LEARNING} | {"ecat.__main__"}
    names = [name.removesuffix(".__init__") for name in names if name not in later]
    loaded = loaded_by("\n".join(f"import {name}" for name in names))
    assert "ecat" in loaded
    assert loaded & NEVER_AT_IMPORT == set()


# --- documents


def test_every_make_command_in_the_documents_exists() -> None:
    targets = set(re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text("utf-8"), flags=re.MULTILINE))
    for path in DOCUMENTS:
        assert set(make_commands(path)) <= targets, name_of(path)


def make_commands(path: Path) -> list[str]:
    """The targets of ``make TARGET`` in code blocks and in code spans."""
    return re.findall(r"(?:^|`)make ([a-z0-9-]+)", path.read_text("utf-8"), flags=re.MULTILINE)


def test_every_verb_in_the_documents_exists(capsys: pytest.CaptureFixture[str]) -> None:
    main = importlib.import_module("ecat.cli").main
    assert main(["--help"]) == 0
    verbs = set(re.findall(r"^  ([a-z]+) ", capsys.readouterr().out, flags=re.MULTILINE))
    for path in DOCUMENTS:
        shell = "".join(
            re.findall(r"^```sh\n(.*?)^```", path.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
        )
        assert set(re.findall(r"^ecat ([a-z]+)", shell, flags=re.MULTILINE)) <= verbs, name_of(path)


def test_the_readme_starts_with_the_demo_and_the_tests() -> None:
    assert make_commands(ROOT / "README.md")[:2] == ["demo", "test"]


def test_links_between_documents_lead_somewhere() -> None:
    for path in DOCUMENTS:
        links = re.findall(r"\]\((?!https?:|mailto:|#)([^)#\s]+)", path.read_text("utf-8"))
        assert [link for link in links if not (path.parent / link).exists()] == [], name_of(path)


# --- shape


def test_every_public_module_says_what_it_is_for() -> None:
    public = [path for path in SOURCES if path.stem == "__init__" or not path.stem.startswith("_")]
    assert [name_of(path) for path in public if not ast.get_docstring(ast.parse(path.read_bytes()))] == []


def test_modules_and_functions_fit_in_the_head() -> None:
    too_long: dict[str, int] = {}
    for path in [*SOURCES, *OTHERS]:
        source = path.read_text("utf-8")
        lengths = {name_of(path): len(source.splitlines()) - MAX_MODULE_LINES}
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                lengths[f"{name_of(path)}::{node.name}"] = lines - MAX_FUNCTION_LINES
        too_long |= {name: excess for name, excess in lengths.items() if excess > 0}
    assert too_long == {}
