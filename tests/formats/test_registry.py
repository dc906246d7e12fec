"""Formats by name, by looks, and from other packages."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from ecat import formats
from ecat.errors import FormatError, NotFoundError, UsageError
from ecat.formats import Format, import_source, registry


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    caches = (registry.all_formats, registry.places, registry.load)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


def test_ecat_s_own_formats_are_there_in_the_order_of_their_names() -> None:
    names = [known.name for known in registry.all_formats()]
    assert names == sorted(names)
    assert {"ecat-2018", "poses", "poses-smooth"} <= set(names)
    assert registry.find("ecat-2018").reads
    assert registry.find("ecat-2018").writes
    assert not registry.find("poses").reads


@dataclass
class Point:
    name: str
    value: str


def test_another_package_adds_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    mine = Format(name="mine", description="what I have", sniff=lambda path: path.suffix == ".mine")
    monkeypatch.setattr(
        registry,
        "entry_points",
        lambda group: [Point("mine", "my.module")] if group == "ecat.formats" else [],
    )
    load = registry.import_module
    monkeypatch.setattr(
        registry,
        "import_module",
        lambda name: SimpleNamespace(FORMAT=mine) if name == "my.module" else load(name),
    )
    assert registry.find("mine") is mine


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(UsageError, match="unknown format 'anvil'") as caught:
        registry.find("anvil")
    assert ", ".join(known.name for known in registry.all_formats()) in caught.value.where


class TestSniffing:
    def test_no_format_is_loaded_behind_the_one_that_it_is(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        first = Format(name="a", description="it", sniff=lambda _: True)
        loaded: list[str] = []

        def load(name: str, value: str) -> Format:
            loaded.append(value)
            return first

        monkeypatch.setattr(registry, "places", lambda: {"b": "second", "a": "first"})
        monkeypatch.setattr(registry, "load", load)
        assert registry.sniff(tmp_path) is first
        assert loaded == ["first"]

    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(NotFoundError):
            registry.sniff(tmp_path / "nothing")

    def test_nothing_known(self, tmp_path: Path) -> None:
        with pytest.raises(FormatError, match="cannot import") as caught:
            registry.sniff(tmp_path)
        assert "--format NAME" in caught.value.fix

    def test_a_session_folder(self, tmp_path: Path) -> None:
        (tmp_path / "files.param").write_text("<session />")
        assert registry.sniff(tmp_path).name == "ecat-2018"


class TestDirections:
    def test_a_format_that_is_only_written_is_not_read(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="poses is only written, not read"):
            formats.import_source(tmp_path, tmp_path / "out", format="poses")

    def test_a_format_that_is_only_read_is_not_written(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        only_read = Format(name="r", description="", read=registry.find("ecat-2018").read)
        monkeypatch.setattr(registry, "find", lambda _: only_read)
        with pytest.raises(UsageError, match="r is only read, not written"):
            formats.export(tmp_path, tmp_path / "out", format="r")


def test_a_package_that_cannot_be_loaded_does_not_take_the_others_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry, "entry_points", lambda group: [Point("broken", "no_such_module_at_all")])
    assert registry.find("ecat-2018").reads
    assert "cannot be loaded: ModuleNotFoundError" in registry.find("broken").description


@pytest.mark.parametrize("file", ["session.json", "project.json"])
@pytest.mark.parametrize("insisted", [None, "ecat-2018"])
def test_what_ecat_made_is_not_imported_again(tmp_path: Path, file: str, insisted: str | None) -> None:
    (tmp_path / file).write_text("{}")
    kind = file.removesuffix(".json")
    for source in (tmp_path, tmp_path / file):
        with pytest.raises(FormatError, match=f"is an ecat {kind} already") as caught:
            import_source(source, tmp_path / "made", format=insisted)
        assert f"ecat info {tmp_path}" in caught.value.fix
        assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("name", ["source", "dest"])
def test_names_that_are_not_utf8_are_refused_before_anything_is_read(tmp_path: Path, name: str) -> None:
    """Names of source and destination become names inside of the session."""
    bad = tmp_path / os.fsdecode(b"a\xff")
    source, dest = (bad, tmp_path / "s") if name == "source" else (tmp_path / "nothing", bad)
    with pytest.raises(FormatError, match="the name is not UTF-8"):
        import_source(source, dest)
