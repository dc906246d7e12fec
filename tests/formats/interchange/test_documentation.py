"""The page about these formats says what the code does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ecat.formats.interchange import boris, coco, cvat, elan, epic, label_studio, plain_csv, via, vidat
from ecat.formats.interchange.leftovers import KINDS
from ecat.formats.options import describe

MODULES: tuple[Any, ...] = (elan, cvat, label_studio, coco, via, vidat, epic, boris, plain_csv)
PAGE = Path(__file__).parents[3] / "docs" / "formats" / "interchange.md"


def carried_table() -> str:
    """What is carried, as the formats declare it."""

    def cell(kind: str, module: Any) -> str:
        return "yes" if kind in module.CARRIES else "in part" if kind in getattr(module, "PARTLY", ()) else ""

    head = " | ".join(f"`{module.NAME}`" for module in MODULES)
    rows = [f"| {kind} | {' | '.join(cell(kind, module) for module in MODULES)} |" for kind in KINDS]
    return "\n".join([f"| | {head} |", "|---" * (len(MODULES) + 1) + "|", *rows]) + "\n"


def test_the_table_of_what_is_carried_is_that_of_the_code() -> None:
    assert carried_table() in PAGE.read_text(encoding="utf-8"), f"docs/{PAGE.name} needs:\n{carried_table()}"


def test_every_option_is_explained() -> None:
    text = PAGE.read_text(encoding="utf-8")
    options = {option.name for module in MODULES for option in describe(module.FORMAT.options)}
    assert [name for name in sorted(options) if f"`{name}`" not in text] == []


def test_every_format_states_what_it_cannot_carry() -> None:
    for module in MODULES:
        assert "no place for" in " ".join((module.__doc__ or "").split()), module.__name__
