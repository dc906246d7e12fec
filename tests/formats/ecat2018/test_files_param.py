"""What a session file says, in the model's terms; trap numbers are those of the file format's §0."""

from __future__ import annotations

from math import isnan, nan
from pathlib import Path

import pytest

from ecat.errors import EcatError, FormatError, InputError, LimitError
from ecat.formats.ecat2018.files_param import read_files_param
from ecat.model import AnnotatedObject, Clock, Property, Segment
from tests.formats.ecat2018.documents import (
    BOM,
    CODE,
    CORNERS,
    POINTS,
    box,
    box_marker,
    document,
    event,
    face,
    location,
    markers,
    obj,
    predicate,
    read,
)

PLAIN_CODE = CODE.replace(" ,", "").strip()


def only_object(body: str) -> AnnotatedObject:
    """The object of a document with one."""
    (found,) = read(document(objects=body)).layer.objects
    return found


class TestTraps:
    def test_trap_01_events_without_a_counter_are_read(self) -> None:
        """ECAT's last version lost the events of every file without `annotations/@no`."""
        said = read(document(events=event(id="a1") + event(id="a7")))
        assert [e.id for e in said.layer.events] == ["a1", "a7"]
        assert said.layer.event_counter == 7

    def test_trap_02_infinity_is_a_character(self) -> None:
        points = POINTS.replace("-0.1955648,-0.2209547,1.445", "-∞,-∞,-∞")
        said = read(document(objects=box(box_marker(0, face()), box_marker(0, face(points), dimensions=3))))
        corners = said.faces_3d[0].columns().corners[0]
        assert [isnan(value) for value in corners] == [True] * 3 + [False] * 9

    def test_trap_03_2d_and_3d_corners_keep_their_own_order(self) -> None:
        """Each list starts at its own smallest x + y: pairing them is for whoever knows the camera."""
        said = read(document(objects=box(box_marker(0, face()), box_marker(0, face(POINTS), dimensions=3))))
        assert said.faces_2d[0].columns().corners[0].tolist() == [float(x) for x in CORNERS.split(",")]
        assert said.faces_3d[0].columns().corners[0, :3].tolist() == [0.1955648, 0.2209547, 1.445]
        assert said.faces_3d[0].columns().corners[0, 3:6].tolist() == [0.1970665, 0.1404356, 1.426]

    def test_trap_04_the_code_is_kept_as_read(self) -> None:
        """It is oriented by the leftmost corner, the polygon by the smallest x + y: neither is turned here."""
        turned = PLAIN_CODE[::-1]
        faces = face() + face(code=" ,".join(turned) + " ")
        said = read(document(objects=box(box_marker(0, faces))))
        assert said.book.codes == [PLAIN_CODE, turned]

    def test_trap_05_mirrored_codes_are_not_mirrored_back(self) -> None:
        said = read(document(objects=box(box_marker(0, face()))))
        assert said.book.codes == [PLAIN_CODE]

    def test_trap_09_detections_count_images_from_zero_and_all_else_counts_track_bar_positions(self) -> None:
        said = read(
            document(
                objects=box(box_marker(12, face()), id="o1") + obj(markers(location(12)), id="o2"),
                events=event(start=12, end=20),
                predicates=predicate(12, "o2", "STAND(X)"),
            )
        )
        assert said.faces_2d[0].columns().frames.tolist() == [12]
        assert said.layer.objects[1].key_frames[0].frame == 11
        assert said.layer.events[0].segments == (Segment(start_frame=11, end_frame=20),)
        assert said.layer.relations[0].start_frame == 11

    def test_trap_09_position_0_shows_the_first_image_and_is_kept_as_frame_minus_1(self) -> None:
        assert only_object(obj(markers(location(0), location(1)))).key_frames[0].frame == -1

    def test_trap_10_the_start_is_local_time_without_a_zone(self) -> None:
        """The file says Z; nobody knows the zone."""
        head = 'name="Session1" length="2649" duration="88357" startWriteRGB="2017-10-04T22:35:30.583746Z"'
        assert read(document(head=head)).clock == Clock(
            rule="uniform", start="2017-10-04T22:35:30.583746", duration_ns=88_357_000_000
        )

    def test_trap_11_references_actions_and_links_are_read_although_no_file_has_any(self) -> None:
        rest = (
            '      <refs>\n        <ref start="0" end="4" refTo="o2" />\n      </refs>\n'
            '      <events>\n        <event start="5" end="9" semanticType="pour" />\n      </events>\n'
            '      <link>\n        <linkTo id="a2" type="SUBEVENT(X,Y)" />\n      </link>\n'
        )
        (found,) = read(document(events=event(rest=rest))).layer.events
        assert [(r.start, r.end, r.target) for r in found.references] == [(0, 4, "o2")]
        assert [(p.start, p.end, p.type) for p in found.predicates] == [(5, 9, "pour")]
        assert [(link.target, link.type) for link in found.links] == [("a2", "SUBEVENT")]


class TestSession:
    def test_an_empty_session(self) -> None:
        said = read(document())
        assert (said.name, said.n_frames, said.layer.objects, said.findings) == ("Session1", 100, (), [])

    def test_a_session_without_any_section(self) -> None:
        assert read('<session name="a" length="3" />').n_frames == 3

    @pytest.mark.parametrize("said", ["x", "-1", "", "1.5", "9" * 30])
    def test_a_length_that_is_no_count_is_0(self, said: str) -> None:
        assert read(document(head=f'name="a" length="{said}"')).n_frames == 0

    def test_without_a_duration_there_is_no_clock(self) -> None:
        assert read(document()).clock == Clock()

    def test_the_object_counter_may_be_beyond_the_highest_id(self) -> None:
        assert read(document(objects=obj(id="o2"))).layer.object_counter == 5

    def test_files_are_listed(self) -> None:
        files = "    <file>a.avi</file>\n    <file>C:\\x\\b &amp; c.xml</file>\n"
        assert read(document(files=files)).files == ["a.avi", "C:\\x\\b & c.xml"]

    def test_sections_may_come_in_any_order(self) -> None:
        said = read("<session><predicates /><annotations /><objects /><files /></session>")
        assert said.foreign["sections"] == "predicates,annotations,objects,files"

    def test_a_section_that_occurs_twice_is_put_together(self) -> None:
        two = document(objects=obj(id="o1")).replace(
            "  <annotations />", f"  <objects>\n{obj(id='o2')}  </objects>"
        )
        said = read(two)
        assert [o.id for o in said.layer.objects] == ["o1", "o2"]
        assert said.findings == ["a section occurs more than once; put together"]


class TestObjects:
    def test_attributes(self) -> None:
        said = only_object(
            '    <object id="o3" name=" a &amp; b " filename="C:\\Users\\X\\SlideAway\\rgb.avi" objectType="3D" '
            'generate="Tracked" color="-16777216" borderSize="2" semanticType="table" '
            'shape="Annotator.PolygonObject" weight="heavy" />\n'
        )
        assert (said.id, said.name, said.kind, said.origin) == ("o3", " a & b ", "polygon", "tracked")
        assert (said.dimensions, said.color, said.line_width) == (3, "#000000ff", 2)
        assert (said.semantic_type, said.stream) == ("table", "rgb.avi")
        assert said.properties == (Property("weight", "heavy"),)

    @pytest.mark.parametrize(
        ("shape", "kind"),
        [
            ("Annotator.RectangleObject", "rectangle"),
            ("Rectangle", "rectangle"),
            ("Polygon", "polygon"),
            ("Annotator.GlyphBoxObject", "marker_box"),
            ("Annotator.RigObject", "rig"),
            ("Annotator.CubeObject", "other"),
        ],
    )
    def test_shapes(self, shape: str, kind: str) -> None:
        assert only_object(obj(shape=shape)).kind == kind

    def test_before_march_2016_the_shape_was_on_each_marker(self) -> None:
        body = '<marker type="LOCATION" frame="1" shape="Rectangle">1,2,3,4</marker>'
        assert (
            only_object(obj(f"      {body}\n").replace(' shape="Annotator.RectangleObject"', "")).kind
            == "rectangle"
        )

    def test_an_absence_has_no_shape(self) -> None:
        keys = only_object(
            obj(markers(location(1), '<marker type="DELETE" frame="9" />', location(20)))
        ).key_frames
        assert [(key.frame, key.present, len(key.coordinates)) for key in keys] == [
            (0, True, 4),
            (8, False, 0),
            (19, True, 4),
        ]

    def test_3d_points_are_in_the_axes_of_the_physical_camera_and_missing_ones_are_nan(self) -> None:
        body = markers(location(1)) + markers('<marker frame="1">1,2,3,-1,-1,-1</marker>', tag="markers3d")
        (key,) = only_object(obj(body)).key_frames_3d
        assert key.coordinates[:3] == (-1, -2, 3)
        assert all(isnan(value) for value in key.coordinates[3:])

    def test_key_frames_out_of_order_are_put_in_order_and_the_last_of_a_frame_counts(self) -> None:
        said = read(document(objects=obj(markers(location(9), location(3), location(9, "5,6,7,8")))))
        keys = said.layer.objects[0].key_frames
        assert [(key.frame, key.coordinates) for key in keys] == [(2, (1, 2, 3, 4)), (8, (5, 6, 7, 8))]
        assert said.findings == ["object o1: key frames out of order or doubled; put in order"]

    def test_an_id_that_is_used_twice_gets_a_suffix_and_a_finding(self) -> None:
        said = read(
            document(
                objects=obj(id="o1") + obj(id="o1~2") + obj(id="o1"), events=event(id="a1") + event(id="a1")
            )
        )
        assert [o.id for o in said.layer.objects] == ["o1", "o1~2", "o1~3"]
        assert [e.id for e in said.layer.events] == ["a1", "a1~2"]
        assert [finding.partition(": ")[2] for finding in said.findings] == [
            "object id 'o1' is used twice; here it is 'o1~3'",
            "event id 'a1' is used twice; here it is 'a1~2'",
        ]


class TestRelations:
    @pytest.mark.parametrize(
        ("ids", "kind", "name", "targets"),
        [
            ("o2", "STAND(X)", "STAND", ("o2",)),
            ("o1,o2", "SUPPORT(X,Y)", "SUPPORT", ("o1", "o2")),
            ("o1,o2", "SUPPORT(Y,X)", "SUPPORT", ("o2", "o1")),
            ("o1,0009_Forrest_Gump/o1", "IDENTITY(X,Y)", "IDENTITY", ("o1", "0009_Forrest_Gump/o1")),
            ("o1", "strange", "strange", ("o1",)),
        ],
    )
    def test_arguments_are_in_reading_order(
        self, ids: str, kind: str, name: str, targets: tuple[str, ...]
    ) -> None:
        (found,) = read(document(predicates=predicate(5, ids, kind))).layer.relations
        assert (found.predicate, found.targets, found.start_frame) == (name, targets, 4)

    @pytest.mark.parametrize(
        ("said", "polarity"), [("True", True), ("False", False), ("false", False), ("", True)]
    )
    def test_polarity(self, said: str, polarity: bool) -> None:
        (found,) = read(document(predicates=predicate(5, "o1", "STAND(X)", said))).layer.relations
        assert found.polarity is polarity

    def test_an_object_of_another_session_that_is_not_there_stays_a_reference(self) -> None:
        (found,) = read(document(predicates=predicate(0, "o1,gone/o99", "IDENTITY(X,Y)"))).layer.relations
        assert found.targets == ("o1", "gone/o99")

    def test_older_links_are_relations_of_the_object_that_contains_them(self) -> None:
        links = (
            '      <links>\n        <link frame="38">\n          <linkTo id="o2" q="False" type="LOOK_AT" />\n'
            '          <linkTo otherSession="0009" id="o7" q="True" type="IDENTITY" />\n'
            '          <linkTo q="True" type="STAND" />\n        </link>\n      </links>\n'
        )
        found = read(document(objects=obj(links))).layer.relations
        assert [(r.predicate, r.targets, r.start_frame, r.polarity) for r in found] == [
            ("LOOK_AT", ("o1", "o2"), 37, False),
            ("IDENTITY", ("o1", "0009/o7"), 37, True),
            ("STAND", ("o1",), 37, True),
        ]


UNKNOWN = {
    "in the session": ("</session>", "<z/></session>", "<z> inside of <session>"),
    "in a section": ("  <annotations />", "  <annotations><z/></annotations>", "<z> inside of <annotations>"),
    "in an object": ("</object>", "<z/></object>", "<z> inside of <object>"),
    "a known one in the wrong place": ("</object>", "<ref/></object>", "<ref> inside of <object>"),
    "among markers": ("</markers>", "<z/></markers>", "<z> inside of <markers>"),
}


@pytest.mark.parametrize(("old", "new", "finding"), UNKNOWN.values(), ids=UNKNOWN)
def test_unknown_elements_are_reported(old: str, new: str, finding: str) -> None:
    said = read(document(objects=obj(markers(location(1)))).replace(old, new))
    assert [f.partition(": ")[2] for f in said.findings] == [
        f"{finding} is not part of the format and was not imported"
    ]


def test_more_in_a_face_than_a_polygon_and_a_code_is_reported() -> None:
    """Of 18-20 April 2016: the points inside of the 2-D face."""
    extra = face().replace("</code>", "</code><bounding3d>1,2,3</bounding3d>")
    said = read(document(objects=box(box_marker(4, extra))))
    assert said.faces_2d[0].columns().frames.tolist() == [4]
    assert [f.partition(", ")[2] for f in said.findings] == [
        "<face> 1 of frame 4: more than <bounding> and <code>; not imported"
    ]


# ---------------------------------------------------------------------------------------------- bad input

FULL = document(
    files="    <file>a.avi</file>\n",
    objects=box(box_marker(0, face()), box_marker(0, face(POINTS), dimensions=3), id="o1")
    + obj(markers(location(1)), id="o2"),
    events=event(),
    predicates=predicate(3, "o2", "STAND(X)"),
)


def refusal(data: str | bytes) -> EcatError:
    """The one error of a bad file."""
    with pytest.raises(EcatError) as caught:
        read(data)
    assert caught.value.what == "cannot import Session1/files.param"
    assert caught.value.where
    return caught.value


def test_a_bad_face_says_what_where_and_what_to_do() -> None:
    faces = "".join(box_marker(i, face(), face()) for i in range(1204)) + box_marker(
        1204, face(), face(code=CODE[:-3])
    )
    text = document(objects=box(faces))
    line = next(i for i, line in enumerate(text.split("\n"), 1) if f"<code>{CODE[:-3]}</code>" in line) - 2
    assert str(refusal(text)).split("\n") == [
        "cannot import Session1/files.param",
        f"  line {line}, <face> 2 of frame 1204: expected 25 cells of 0 or 1 in <code>, found 24",
        "  the rest of the session was not imported; nothing was written",
        "  try: ecat import --skip-bad-markers ...",
    ]


def test_a_bad_face_may_be_skipped() -> None:
    text = document(
        objects=box(box_marker(0, face(), face(code=CODE[:-3]))) + obj(markers(location(1, "1,x")), id="o2")
    )
    said = read(text, skip_bad_markers=True)
    assert len(said.faces_2d[0]) == 2
    assert len(said.findings) == 2
    assert said.layer.objects[1].key_frames[0].coordinates == ()


@pytest.mark.parametrize("cut", range(0, len(FULL), 97))
def test_a_truncated_file_is_one_error(cut: int) -> None:
    error = refusal(BOM + FULL.encode()[:cut])
    assert isinstance(error, InputError)


BAD = {
    "empty": (b"", FormatError, "empty"),
    "another root": (b"<annotation><x/></annotation>", FormatError, "root element is not <session>"),
    "a session inside of another root": (b"<a><session/></a>", FormatError, "inside of an element"),
    "no XML": (b"RIFF....AVI", FormatError, "not XML"),
    "NUL bytes": (FULL.encode().replace(b"cup", b"c\0p"), FormatError, "NUL"),
    "a document type": (
        FULL.encode().replace(b"<session", b"<!DOCTYPE session><session", 1),
        FormatError,
        "document type",
    ),
    "an entity": (FULL.encode().replace(b'name="cup"', b'name="&cup;"'), FormatError, "line"),
    "UTF-16": ("<session/>".encode("utf-16"), FormatError, "UTF-16"),
    "bad UTF-8": (FULL.encode().replace(b"cup", b"c\xffp"), FormatError, "line"),
    "a frame that is no number": (
        FULL.encode().replace(b'type="LOCATION" frame="1"', b'type="LOCATION" frame="x"'),
        FormatError,
        "whole number",
    ),
    "a frame beyond 32 bits": (
        FULL.encode().replace(b'startFrame="1"', b'startFrame="2147483648"'),
        FormatError,
        "32 bits",
    ),
    "a frame of a million digits": (
        FULL.encode().replace(b'startFrame="1"', b'startFrame="' + b"9" * 1_000_000 + b'"'),
        FormatError,
        "32 bits",
    ),
    "no frame": (FULL.encode().replace(b' frame="3"', b""), FormatError, "found nothing"),
    "a word among coordinates": (
        FULL.encode().replace(b"1,2,3,4", b"1,2,drei,4"),
        FormatError,
        "'drei' is not a number",
    ),
    "another type of marker": (
        FULL.encode().replace(b'type="LOCATION" frame="1"', b'type="MOVE" frame="1"'),
        FormatError,
        "'MOVE'",
    ),
    "a marker in the wrong place": (
        FULL.encode().replace(b"    <annotation ", b'    <marker frame="1" /><annotation '),
        FormatError,
        "outside of an <object>",
    ),
    "faces of a rectangle": (
        FULL.encode().replace(b"GlyphBoxObject", b"RectangleObject"),
        FormatError,
        "no glyph box",
    ),
    "a face without code": (
        FULL.encode().replace(f"<code>{CODE}</code>".encode(), b""),
        FormatError,
        "found <bounding>",
    ),
    "a deep nest": (b"<session>" + b"<a>" * 1_000_000, LimitError, "deeper"),
    "an object of 70 MB": (
        b"<session><objects><object>" + (b"<z>" + b"1" * 1_000_000 + b"</z>") * 70,
        LimitError,
        "bytes in one element",
    ),
}


@pytest.mark.parametrize(("data", "kind", "where"), BAD.values(), ids=BAD)
def test_bad_input_is_one_error_that_says_where(data: bytes, kind: type[EcatError], where: str) -> None:
    error = refusal(data)
    assert type(error) is kind
    assert where in error.where


def test_a_billion_laughs_are_refused_unread() -> None:
    laughs = '<!DOCTYPE s [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>'
    assert "document type" in refusal(FULL.replace("<session", f"{laughs}<session", 1)).where


@pytest.mark.parametrize("number", ["NaN", "1e308", "-1E-300", "Infinity", "-∞"])
def test_strange_numbers_are_kept_or_missing(number: str) -> None:
    (key,) = only_object(obj(markers(location(1, f"{number},2,3,4")))).key_frames
    expected = float(number.replace("∞", "inf"))
    value = expected if abs(expected) < 2e308 else nan
    assert key.coordinates[1:] == (2, 3, 4)
    assert key.coordinates[0] == value or isnan(key.coordinates[0])


def test_two_hundred_thousand_markers_in_an_object_are_read(tmp_path: Path) -> None:
    """As empty markers, which only the parser takes, and as faces of one frame after the other."""
    path = tmp_path / "files.param"
    with path.open("w") as file:
        file.write("<session><files /><objects>\n")
        file.write('<object id="o1" shape="Annotator.GlyphBoxObject">\n      <markers>\n')
        file.writelines(box_marker(i, face()) for i in range(100_000))
        file.writelines(
            f'<marker type="DELETE" frame="{i}" glyphSize="5" />\n' for i in range(100_000, 200_000)
        )
        file.write("</markers></object></objects></session>")
    said = read_files_param(path)
    assert len(said.faces_2d[0]) == 200_000


def test_a_hundred_thousand_faces_in_one_marker_are_read() -> None:
    assert len(read(document(objects=box(box_marker(0, *[face()] * 100_000)))).faces_2d[0]) == 100_000
