"""What worked in ECAT of 2018 has a counterpart, and a test that shows it (docs/annotation.md)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "annotation.md"
NOT_HERE = "Record tab"
"""ECAT's recorder; ecat reads what recorders write."""


def _rows(text: str) -> Iterator[list[str]]:
    for line in text.splitlines():
        if line.startswith("|") and not line.startswith("|-"):
            yield [cell.strip() for cell in line.strip().strip("|").split("|")]


def _counterparts() -> dict[str, tuple[str, str]]:
    """What is here and the test that shows it, by section and name in ECAT."""
    table = DOCUMENT.read_text(encoding="utf-8").partition("## Coming from ECAT")[2]
    return {name: (here, test.strip("`")) for name, here, test in list(_rows(table))[1:]}


def test_every_counterpart_is_shown_by_a_test_that_there_is() -> None:
    for name, (here, test) in _counterparts().items():
        if here == "did not work" or name.startswith(NOT_HERE):
            continue
        file, _, function = test.partition("::")
        source = (ROOT / "tests" / file).read_text(encoding="utf-8")
        assert re.search(rf"def {function}\(", source), f"{name}: {test}"


def test_nothing_that_worked_is_without_a_counterpart(shared: Path) -> None:
    inventory = (shared.parent / "spec" / "ecat_2018.md").read_text(encoding="utf-8")
    table = inventory.partition("## 3. ")[2].partition("\n## 4. ")[0]
    section, wanted, dead = "", set[str](), set[str]()
    for name, *rest in list(_rows(table))[1:]:
        if name.startswith("**"):
            section = re.sub(r"\*\*(.*?)\*\*.*", r"\1", name)
            if not any(rest):
                continue
        full = section if name.startswith("**") else f"{section}: {name}"
        wanted.add(full)
        if any(re.search(r"\*\*(no action|disabled)", cell) for cell in rest):
            dead.add(full)
    found = _counterparts()
    assert wanted - set(found) == set()
    assert {name for name, (here, _) in found.items() if here == "did not work"} == dead
