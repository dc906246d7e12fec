"""Learning exports become sessions with labelled windows, or one error that says what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecat.errors import FormatError, InputError, NotFoundError
from ecat.sample import sample_session
from ecat.store import create_session
from learn.recognize.dataset import exchanged, read_exports, words
from tests.learn.recognize import made


def test_sessions_come_with_their_points_and_a_label_for_each_window(tmp_path: Path) -> None:
    first, *_ = read_exports(made.exports(tmp_path, 1))
    assert first.key == ("pullpast", "pullpast1")
    np.testing.assert_allclose(first.points, made.scene(1, past=True), atol=1e-4)
    assert words(first.labels[0].tolist()) == ["Performer", "Object_1", None, "pull", None]
    assert words(first.labels[-1].tolist()) == ["Performer", "Object_1", "Object_2", "pull", "Past"]


def test_exports_are_found_however_deep_they_lie_and_empty_sessions_are_left_out(tmp_path: Path) -> None:
    made.exports(tmp_path, 2)
    made.write(
        tmp_path / "more.txt", '<session name="nothing" />', made.session("a", made.scene(1), made.labels(1))
    )
    assert [session.file for session in read_exports(tmp_path)] == ["pullpast"] * 2 + ["more"] + [
        "pushto"
    ] * 2


@pytest.mark.parametrize("nowhere", [np.nan, np.inf, 1e300, -2e6])
def test_points_that_are_nowhere_were_not_seen_and_are_counted(nowhere: float, tmp_path: Path) -> None:
    points, findings = made.scene(1), list[str]()
    points[3, 5, 1] = points[7, 14, 0] = nowhere
    made.write(tmp_path / "a.txt", made.session("a", points, made.labels(1)))
    (session,) = read_exports(tmp_path, findings=findings)
    assert np.argwhere(np.isnan(session.points).all(axis=2)).tolist() == [[3, 5], [7, 14]]
    assert [f"{tmp_path / 'a.txt'} has 2 points with no place" in said for said in findings] == [True]


def test_exchanging_the_boxes_twice_changes_nothing(tmp_path: Path) -> None:
    labels = read_exports(made.exports(tmp_path, 1))[0].labels
    assert (exchanged(labels)[:, 1] == 3).all()
    np.testing.assert_array_equal(exchanged(exchanged(labels)), labels)


def test_an_export_can_be_named_itself(tmp_path: Path) -> None:
    folder = made.exports(tmp_path, 2)
    assert [session.key for session in read_exports(folder / "pushto.txt")] == [
        ("pushto", "pushto1"),
        ("pushto", "pushto2"),
    ]


@pytest.mark.parametrize(
    "note", [b"Recorded in 2015.", b"", b"\xef\xbb\xbf \n Notes", b"\x89PNG", b" " * 9000]
)
def test_other_files_beside_exports_are_left_out_and_named(note: bytes, tmp_path: Path) -> None:
    made.exports(tmp_path, 1)
    (tmp_path / "deeper" / "README.txt").write_bytes(note)
    findings: list[str] = []
    assert len(read_exports(tmp_path, findings=findings)) == len(read_exports(tmp_path)) == 2
    assert findings == [
        f"{tmp_path / 'deeper' / 'README.txt'} was left out: it is not XML, so no learning export"
    ]


@pytest.mark.parametrize("before", ["", "\ufeff", "\n \t", "\ufeff\r\n"])
def test_white_space_and_a_byte_order_mark_come_before_xml(before: str, tmp_path: Path) -> None:
    made.write(tmp_path / "a.txt", made.session("a", made.scene(1), made.labels(1)))
    text = (tmp_path / "a.txt").read_text("utf-8")
    (tmp_path / "a.txt").write_text(before + text, "utf-8")
    findings: list[str] = []
    assert len(read_exports(tmp_path, findings=findings)) == 1
    assert findings == []


@pytest.mark.parametrize("data", ["<p".encode("utf-16"), b"<html/>", b"<project>"])
def test_other_xml_is_not_left_out_but_an_error(data: bytes, tmp_path: Path) -> None:
    made.exports(tmp_path, 1)
    (tmp_path / "other.txt").write_bytes(data)
    with pytest.raises(FormatError, match=r"other\.txt"):
        read_exports(tmp_path)


def test_folders_without_an_export_are_an_error_that_names_what_there_is(tmp_path: Path) -> None:
    for number in range(23):
        (tmp_path / f"{number:02}.txt").write_text("no")
    with pytest.raises(NotFoundError) as caught:
        read_exports(tmp_path)
    lines = caught.value.where.split("\n")
    assert len(lines) == 21
    assert "00.txt was left out" in lines[0]
    assert lines[-1] == "3 more were left out: they are not XML"


def test_of_sessions_it_is_said_how_they_become_an_export(tmp_path: Path) -> None:
    create_session(tmp_path / "slide", sample_session(seed=3, actions=("next",), name="slide")[0])
    with pytest.raises(NotFoundError) as caught:
        read_exports(tmp_path)
    assert f"ecat export {tmp_path} exports.txt --format ecat-learning" in caught.value.fix


def test_unknown_labels_are_all_listed_with_their_counts_and_sessions(tmp_path: Path) -> None:
    events = ["Subject,Object,None,throws,None"] * 5 + ["Boss,Object,None,pushes,Over"]
    sessions = [made.session(name, made.scene(1), events[5:] * 6) for name in "bcde"]
    made.write(tmp_path / "a.txt", made.session("a", made.scene(1), events), *sessions)
    with pytest.raises(InputError, match="3 labels not known") as caught:
        read_exports(tmp_path)
    named = ", ".join(f"session {name} of a.txt" for name in "abc")
    assert caught.value.where.split("\n") == [
        f"preposition Over: 25 times, in {named} and 2 sessions more",
        f"role Boss: 25 times, in {named} and 2 sessions more",
        "verb throws: 5 times, in session a of a.txt",
    ]
    assert "learn" not in caught.value.what.replace(str(tmp_path), "") + caught.value.consequence


def test_one_unknown_label_is_one(tmp_path: Path) -> None:
    made.write(tmp_path / "a.txt", made.session("a", made.scene(1)[:20], ["Subject,Object,None,pull,None"]))
    with pytest.raises(InputError, match="1 label not known") as caught:
        read_exports(tmp_path)
    assert caught.value.where == "verb pull: 1 time, in session a of a.txt"


def test_a_great_many_unknown_labels_are_counted(tmp_path: Path) -> None:
    sessions = [
        made.session(f"{n}", made.scene(1)[:20], [f"Subject,Object,None,v{n},None"]) for n in range(22)
    ]
    made.write(tmp_path / "a.txt", *sessions)
    with pytest.raises(InputError) as caught:
        read_exports(tmp_path)
    assert len(caught.value.where.split("\n")) == 21
    assert caught.value.where.endswith("and 2 more")


@pytest.mark.parametrize(
    ("points", "events", "said"),
    [
        (made.scene(1)[:12], [], "12 frames"),
        (made.scene(1), made.labels(1)[:-1], "5 labels, and 6 windows in its 45 frames"),
        (made.scene(1)[:21], [], "0 labels, and 1 window in its 21 frames"),
        (made.scene(1)[:1], [], "1 frame, a window 20"),
        (np.where(np.arange(21)[:, None] < 17, made.scene(1), 0.0), made.labels(1), "box 2 was never seen"),
        (np.where(np.arange(21)[:, None] < 17, made.scene(1), -1.0), made.labels(1), "box 2 was never seen"),
    ],
)
def test_a_session_that_cannot_be_used_is_named(
    points: made.Floats, events: list[str], said: str, tmp_path: Path
) -> None:
    made.write(tmp_path / "a.txt", made.session("odd", points, events))
    with pytest.raises(InputError, match="session odd of") as caught:
        read_exports(tmp_path)
    assert said in caught.value.where


def test_two_actors_in_one_role_are_refused(tmp_path: Path) -> None:
    made.write(tmp_path / "a.txt", made.session("a", made.scene(1), ["Subject,Subject,None,rolls,None"] * 6))
    with pytest.raises(FormatError) as caught:
        read_exports(tmp_path)
    assert "two are Subject" in caught.value.where


def test_two_files_with_a_session_of_the_same_name_are_both_named(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        made.write(tmp_path / folder / "x.txt", made.session("s", made.scene(1), made.labels(1)))
    with pytest.raises(InputError) as caught:
        read_exports(tmp_path)
    assert f"session s of {tmp_path / 'b' / 'x.txt'}" in caught.value.what
    assert f"a session of {tmp_path / 'a' / 'x.txt'}" in caught.value.where


def test_the_same_session_twice_in_a_file_is_refused(tmp_path: Path) -> None:
    made.write(tmp_path / "x.txt", *[made.session("s", made.scene(1), made.labels(1))] * 2)
    with pytest.raises(InputError, match="session s of") as caught:
        read_exports(tmp_path)
    assert "of the file is called the same" in caught.value.where


@pytest.mark.parametrize(("name", "said"), [("missing", "no such file or folder"), ("", "no *.txt in it")])
def test_no_exports_are_an_error(name: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(NotFoundError) as caught:
        read_exports(tmp_path / name)
    assert said in caught.value.where


def test_a_file_that_is_named_has_to_be_an_export(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("notes")
    with pytest.raises(FormatError, match=r"a\.txt"):
        read_exports(tmp_path / "a.txt")
