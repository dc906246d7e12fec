"""It is told when a file will not come back byte for byte."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecat.formats import export, import_source
from ecat.formats.ecat2018 import fidelity
from ecat.formats.ecat2018.fidelity import HASH_KEY, Hashed
from ecat.model import Event, Layer
from ecat.store import open_session
from tests.formats.ecat2018.documents import BOM, document, event, save

COMMENTED = BOM + document(events=event()).replace("<files />", "<files /><!-- mine -->").encode()


def test_a_small_file_is_compared_at_import(tmp_path: Path) -> None:
    report = import_source(save(tmp_path, COMMENTED).parent, tmp_path / "out")
    (finding,) = report.findings
    assert finding == (
        "Session1: line 3: comments, white space, quotes or an order that ECAT does not write are not kept; "
        "export will differ from here on"
    )
    assert HASH_KEY not in open_session(tmp_path / "out").manifest.foreign


class TestLargeFiles:
    @pytest.fixture(autouse=True)
    def everything_is_large(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(fidelity, "COMPARED_BYTES", 1)

    def told(self, tmp_path: Path, data: bytes, edit: bool = False) -> tuple[str, ...]:
        """What the export of an imported file says."""
        import_source(save(tmp_path, data).parent, tmp_path / "out")
        if edit:
            with open_session(tmp_path / "out").write() as commit:
                commit.put_layer(Layer(events=(Event(id="a9"),)))
        return export(tmp_path / "out", tmp_path / "back", format="ecat-2018").findings

    def test_a_file_that_comes_back_is_not_told(self, tmp_path: Path) -> None:
        assert self.told(tmp_path, BOM + document(events=event()).encode()) == ()

    def test_a_file_that_does_not_is_told_at_export(self, tmp_path: Path) -> None:
        assert self.told(tmp_path, COMMENTED) == (
            "Session1: files.param is not the imported file byte for byte: comments or layout were not kept",
        )

    def test_after_an_edit_a_difference_is_no_surprise(self, tmp_path: Path) -> None:
        assert self.told(tmp_path, COMMENTED, edit=True) == ()


def test_the_hash_is_that_of_what_has_passed() -> None:
    pieces = Hashed([b"a", b"bc"])
    assert list(pieces) == [b"a", b"bc"]
    assert pieces.sha256 == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
