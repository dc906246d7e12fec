"""What journals are for when a layer is lost, and journals that are none."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from ecat import check as doctor
from ecat.annotate import AddEvent, Editor
from ecat.check import Finding, repair
from ecat.model import AnnotatedObject, Clock, Layer, Manifest
from ecat.store import Draft, create_session, open_session


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A session that nobody has annotated yet."""
    manifest = Manifest(
        name="session",
        created="2026-01-01T00:00:00Z",
        n_frames=100,
        clock=Clock(rule="uniform", duration_ns=3_300_000_000),
    )
    layers = (Layer(objects=(AnnotatedObject(id="o7"),)),)
    create_session(tmp_path / "session", Draft(manifest=manifest, layers=layers))
    return tmp_path / "session"


@pytest.fixture
def edited(session: Path) -> Path:
    """One whose layer has a history."""
    with Editor(open_session(session), author="ann") as editor:
        editor.apply(AddEvent(segments=((0, 5),)))
    return session


def check(path: Path, *, deep: bool = False) -> list[Finding]:
    """What is wrong with a session."""
    return [finding for finding in doctor.check(path, deep=deep) if finding.severity != "note"]


def only(findings: list[Finding]) -> Finding:
    (finding,) = findings
    return finding


class TestALayerThatOnlyItsJournalTells:
    """The whole history of a layer is in its journal, so that its XML can be written anew."""

    def xml(self, path: Path) -> Path:
        """The file of the layer."""
        return path / "annotations" / "main.xml"

    def damaged(self, path: Path, content: bytes | None) -> None:
        """Lose the XML, or put something else in its place."""
        self.xml(path).unlink() if content is None else self.xml(path).write_bytes(content)

    @pytest.mark.parametrize(
        "content",
        [None, b"", b"<annotation", b'<annotation wings="2"/>'],
        ids=["gone", "empty", "cut", "wrong"],
    )
    def test_is_written_anew_byte_for_byte(self, edited: Path, content: bytes | None) -> None:
        before, manifest = self.xml(edited).read_bytes(), (edited / "session.json").read_bytes()
        self.damaged(edited, content)
        findings = check(edited)
        assert {(f.code, f.place) for f in findings} == {("layer-unreadable", "layer main")}
        assert findings[0].fix == f"ecat check {edited} --repair"
        assert repair(edited, findings).failed == []
        assert check(edited, deep=True) == []
        assert self.xml(edited).read_bytes() == before
        assert (edited / "session.json").read_bytes() == manifest
        aside = [path.read_bytes() for path in self.xml(edited).parent.glob("*.old")]
        assert aside == ([] if content is None else [content])

    def test_comes_back_with_what_was_not_saved_yet(self, edited: Path) -> None:
        editor = Editor(open_session(edited), author="bob")
        editor.apply(AddEvent(segments=((5, 8),)))
        wanted = editor.layer
        self.damaged(edited, None)
        assert repair(edited, check(edited)).failed == []
        assert check(edited, deep=True) == []
        assert open_session(edited).layer() == wanted

    def test_comes_back_before_it_was_ever_saved(self, session: Path) -> None:
        editor = Editor(open_session(session), author="ann")
        editor.apply(AddEvent(segments=((5, 8),)))
        self.damaged(session, None)
        assert repair(session, check(session)).failed == []
        assert open_session(session).layer() == editor.layer

    def test_does_not_hide_what_else_is_wrong(self, edited: Path) -> None:
        self.damaged(edited, None)
        (edited / "tables/events.parquet").write_bytes(b"PAR1")
        repair(edited, check(edited))
        repair(edited, check(edited))
        assert check(edited, deep=True) == []

    @pytest.mark.parametrize(
        ("harm", "why"),
        [
            (lambda lines: lines[1:], "it does not begin with the layer that it continues"),
            (lambda lines: lines[:1], "revision 1 does not end at byte"),
            (lambda _: [], "it does not begin with"),
            (
                lambda lines: [lines[0].replace(b'"objects"', b'"subjects"'), *lines[1:]],
                "it does not begin with",
            ),
            (
                lambda lines: [lines[0], lines[1].replace(b'"revision":1', b'"revision":7')],
                "revision 7 follows, expected 1",
            ),
            # as long as it was
            (
                lambda lines: [
                    re.sub(rb'"sha256":".{15}', b'"sha256":"', lines[0]).replace(
                        b'"layer":{', b'"layer":{"name":"other",'
                    ),
                    *lines[1:],
                ],
                "it is that of layer other",
            ),
        ],
    )
    def test_is_left_alone_where_the_journal_does_not_tell_all_of_it(
        self, edited: Path, harm: Callable[[list[bytes]], list[bytes]], why: str
    ) -> None:
        journal = edited / "annotations" / "main.journal.jsonl"
        journal.write_bytes(b"".join(harm(journal.read_bytes().splitlines(keepends=True))))
        self.damaged(edited, b"<annotation")
        (finding,) = (f for f in check(edited) if f.code == "layer-unreadable")
        assert finding.repair == ""
        assert "; its journal cannot replace it: " in finding.message
        assert why in finding.message
        assert self.xml(edited).read_bytes() == b"<annotation"

    def test_is_left_alone_where_the_journal_is_gone(self, edited: Path) -> None:
        (edited / "annotations" / "main.journal.jsonl").unlink()
        self.damaged(edited, None)
        (finding,) = (f for f in check(edited) if f.code == "layer-unreadable")
        assert (finding.repair, "its journal cannot replace it" in finding.message) == ("", True)


@pytest.mark.parametrize("inside", [True, False], ids=["inside", "outside"])
def test_a_journal_that_is_a_link_is_found_and_not_followed(
    edited: Path, tmp_path: Path, inside: bool
) -> None:
    journal = edited / "annotations" / "main.journal.jsonl"
    target = edited / "moved.jsonl" if inside else tmp_path / "secret.jsonl"
    journal.rename(target)
    content = target.read_bytes()
    journal.symlink_to(target)
    finding = only(check(edited, deep=True))
    assert (finding.severity, finding.code, finding.place) == ("error", "journal-link", "layer main, journal")
    assert str(target) in finding.message
    assert finding.repair == ""
    (edited / "annotations/main.xml").unlink()
    (unreadable,) = (f for f in check(edited) if f.code == "layer-unreadable")
    assert unreadable.repair == ""
    assert target.read_bytes() == content


def test_a_link_in_the_place_of_a_journal_to_come_is_found(session: Path) -> None:
    (session / "annotations" / "new.journal.jsonl").symlink_to(session / "nowhere")
    assert only(check(session)).place == "layer new, journal"
    assert not (session / "nowhere").exists()
