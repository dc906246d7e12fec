"""The fast path takes exactly what the parser would have given."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from ecat.formats.ecat2018.face_markup import Run
from ecat.formats.ecat2018.face_scanner import FaceScanner
from tests.formats.ecat2018.documents import CODE, CORNERS, POINTS, box, box_marker, document, face, obj

Face = tuple[int, int, int, str, str]  # dimensions, frame, size, corners, code

SMALL = document(
    objects=box(
        box_marker(0, face(), face("1,2,3,4,5,6,7,8")) + box_marker(7, face()),
        box_marker(0, face(POINTS), face(POINTS), dimensions=3) + box_marker(7, face(POINTS), dimensions=3),
    )
)


def scanned(data: bytes, size: int = 1 << 18) -> tuple[list[Face], bytes]:
    """The faces that the scanner took from a document in pieces of `size`, and what it left of the document."""
    faces: list[Face] = []

    def take(dimensions: int, run: Run) -> None:
        corners, codes = (iter(cast("list[bytes]", texts.to_pylist())) for texts in (run.corners, run.codes))
        for frame, cells, count in zip(
            run.frames.tolist(), run.sizes.tolist(), run.counts.tolist(), strict=True
        ):
            texts = zip(islice(corners, count), islice(codes, count), strict=True)
            faces.extend((dimensions, frame, cells, corner.decode(), code.decode()) for corner, code in texts)

    pieces = (data[i : i + size] for i in range(0, len(data), size))
    return faces, b"".join(FaceScanner(take).cut(pieces))


def parsed(data: bytes) -> list[Face]:
    """The faces that a parser finds."""
    return list(_parsed(etree.fromstring(data)))


def _parsed(root: etree._Element) -> Iterator[Face]:  # pyright: ignore[reportPrivateUsage]
    for marker in root.iter("marker"):
        parent = marker.getparent()
        assert parent is not None
        for found in marker.iter("face"):
            yield (
                3 if parent.tag == "markers3d" else 2,
                int(marker.get("frame", "")),
                int(marker.get("glyphSize", "")),
                found.findtext("bounding", ""),
                found.findtext("code", ""),
            )


def test_faces_are_taken_and_the_rest_goes_to_the_parser() -> None:
    faces, rest = scanned(SMALL.encode())
    assert faces == parsed(SMALL.encode())
    assert len(faces) == 6
    assert b"<face>" not in rest
    assert rest.count(b"<markers") == 2


def test_the_rest_has_as_many_lines_so_that_errors_name_the_right_one() -> None:
    _, rest = scanned(SMALL.encode())
    assert rest.count(b"\n") == SMALL.count("\n")
    assert rest[: rest.index(b"</object>")].count(b"\n") == SMALL[: SMALL.index("</object>")].count("\n")


@pytest.mark.parametrize("size", [6, 7, 64, 300, 1000])
def test_it_does_not_matter_how_the_document_is_cut_into_pieces(size: int) -> None:
    faces, rest = scanned(SMALL.encode(), size)
    assert faces == parsed(SMALL.encode())
    assert (rest.count(b"\n"), b"<face>" in rest) == (SMALL.count("\n"), False)


def test_it_does_not_matter_where_the_document_is_cut_in_two() -> None:
    data = SMALL.encode()
    whole = scanned(data)
    for cut in range(len("<?xml"), len(data)):
        counts: list[int] = []
        scanner = FaceScanner(lambda _, run, counts=counts: counts.append(len(run.corners)))
        rest = b"".join(scanner.cut(iter((data[:cut], data[cut:]))))
        assert (sum(counts), rest) == (len(whole[0]), whole[1]), cut


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_pieces_that_cut_the_declaration_leave_all_to_the_parser(size: int) -> None:
    """Only a whole `<?xml` at the start is known to hide nothing; files are never read in such pieces."""
    assert scanned(SMALL.encode(), size) == ([], SMALL.encode())


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_both_line_ends_are_taken(line_end: str) -> None:
    faces, rest = scanned(SMALL.replace("\n", line_end).encode())
    assert len(faces) == 6
    assert b"<face>" not in rest


HIDING = {
    "a comment": "<!-- <markers> -->",
    "a processing instruction": "<?x <markers> ?>",
    "an entity": "<y>&amp;</y>",
    "a CDATA section": "<x><![CDATA[<markers>]]></x>",
}


@pytest.mark.parametrize("markup", HIDING.values(), ids=HIDING)
@pytest.mark.parametrize("size", [1, 5, 1 << 18])
def test_nothing_is_taken_after_markup_that_could_hide_faces(markup: str, size: int) -> None:
    data = SMALL.replace("  <objects", f"  {markup}\n  <objects").encode()
    assert scanned(data, size) == ([], data)


def test_faces_in_a_comment_are_not_taken() -> None:
    hidden = SMALL.replace("<markers>", "<!--\n<markers>").replace("</object>", "-->\n</object>").encode()
    assert scanned(hidden) == ([], hidden)


OTHER_LAYOUTS = {
    "a blank inside a tag": ("<face>", "<face >"),
    "text between elements": ("<face>", "x<face>"),
    "tabs": ("          <face>", "\t<face>"),
    "another attribute": ('glyphSize="5"', 'glyphSize="5" x="1"'),
    "attributes in another order": ('type="LOCATION" frame="7"', 'frame="7" type="LOCATION"'),
    "single quotes": ('frame="7"', "frame='7'"),
    "a huge frame": ('frame="7"', 'frame="70000000000"'),
    "a negative frame": ('frame="7"', 'frame="-7"'),
    "elements swapped": (f"<bounding>{CORNERS}</bounding>\n            ", ""),
    "a face without code": (f"            <code>{CODE}</code>\n", ""),
    "a marker without faces": (box_marker(7, face()), box_marker(7) + box_marker(8, face())),
    "an absence": (box_marker(7, face()), box_marker(7, face()).replace("LOCATION", "DELETE")),
}


@pytest.mark.parametrize(("old", "new"), OTHER_LAYOUTS.values(), ids=OTHER_LAYOUTS)
def test_another_layout_goes_to_the_parser(old: str, new: str) -> None:
    """What was taken before it is the same as ever, and nothing is lost."""
    data = SMALL.replace(old, new).encode()
    faces, rest = scanned(data)
    left = etree.fromstring(rest)
    assert sorted([*faces, *_parsed(left)]) == sorted(parsed(data))
    assert len(list(left.iter("face"))) > 0 or "without faces" in new


def test_of_two_odd_markers_the_first_counts() -> None:
    """An odd code is seen before an odd head is: what stands between them is not lost."""
    odd = (box_marker(i, face()).replace("LOCATION", "MOVED" if i == 2 else "LOCATION") for i in range(4))
    data = document(objects=box("".join(odd) + box_marker(4, face().replace("<code>", "<code >")))).encode()
    faces, rest = scanned(data)
    assert [frame for _, frame, *_ in faces] == [0, 1]
    assert sorted([*faces, *parsed(rest)]) == parsed(data)


def test_a_document_without_faces_comes_through_as_it_is() -> None:
    data = document(objects=obj("      <markers>\n      </markers>\n")).encode()
    assert scanned(data, 10) == ([], data)


_PLACES = [i for i in range(len(SMALL)) if SMALL[i] in "<>\n"]


@given(
    st.lists(
        st.tuples(st.sampled_from(_PLACES), st.sampled_from([" ", "\n", "\r\n", "<!-- x -->", "\t", ""])),
        max_size=3,
    ),
    st.integers(1, 4000),
)
@settings(max_examples=300)
def test_white_space_and_comments_anywhere_change_nothing(edits: list[tuple[int, str]], size: int) -> None:
    """Taken and left together are what a parser finds in the whole document, whatever its layout."""
    said = SMALL
    for place, inserted in sorted(edits, reverse=True):
        said = said[:place] + inserted + said[place + (inserted == "") :]
    data = said.encode()
    try:
        expected = parsed(data)
    except (etree.XMLSyntaxError, ValueError):
        return  # what is no XML is refused by the parser, which gets to see it
    faces, rest = scanned(data, size)
    plain = [
        (d, f, s, corners.replace("\r\n", "\n"), code.replace("\r\n", "\n"))
        for d, f, s, corners, code in faces
    ]
    assert sorted([*plain, *parsed(rest)]) == sorted(expected)


class TestLines:
    def test_the_line_of_a_face_is_that_of_its_tag(self) -> None:
        runs: list[Run] = []
        list(FaceScanner(lambda _, run: runs.append(run)).cut([SMALL.encode()]))
        lines = SMALL.split("\n")
        found = [run.line(i) for run in runs for i in range(len(run.corners))]
        assert found == [number for number, line in enumerate(lines, 1) if "<face>" in line]


def test_lists_of_another_layout_take_linear_time() -> None:
    """A hundred thousand lists, each of which starts as expected and goes on otherwise: a second, not an hour."""
    one = '<markers>\n<marker type="LOCATION" frame="1" glyphSize="5">\n</marker></markers>\n'
    data = (one * 100_000).encode()
    assert scanned(data)[0] == []
