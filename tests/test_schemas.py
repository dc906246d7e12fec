"""`schemas/` is what the code says."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

from ecat import checkout
from ecat.checkout import checkout_folder
from ecat.errors import UsageError
from ecat.schemas import generated, main

FOLDER = checkout_folder("schemas")
HAND_WRITTEN = {"ecat-2018.xsd"}


@pytest.mark.parametrize("name", sorted(generated()))
def test_a_generated_schema_has_not_drifted(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == generated()[name], "run `make docs`"


def test_nothing_else_lies_in_schemas() -> None:
    there = {str(path.relative_to(FOLDER)) for path in FOLDER.rglob("*") if path.is_file()}
    assert there == set(generated()) | HAND_WRITTEN


def test_the_annotation_schema_is_a_valid_schema(tmp_path: Path) -> None:
    path = tmp_path / "annotation.xsd"
    path.write_text(generated()["annotation.xsd"], encoding="utf-8")
    etree.XMLSchema(etree.parse(path))


def test_an_installed_package_does_not_write_beside_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkout, "ROOT", tmp_path)
    with pytest.raises(UsageError, match="not a checkout of ecat"):
        main()
    assert list(tmp_path.iterdir()) == []
