"""The geometry of a box comes out of a recording of it, whatever the prototype tables say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from ecat.errors import InputError
from ecat.geometry.boxfit import SUBPIXEL
from ecat.geometry.transforms import Rigid, matrix_about_z
from ecat.model.prototype import PEPSI, STELLA_ARTOIS, BoxPrototype
from ecat.stages.calibrate import CalibrationParameters, Recording, calibrate_boxes, recordings_on, sufficient
from tests.stages.recorded import TABLE, Recorded, read_code

Generated = Callable[..., Recorded]
ANOTHER = dict(zip((f.code for f in STELLA_ARTOIS.faces), (f.code for f in PEPSI.faces), strict=True))
"""The codes of one box as those of the other."""


def shown_as(session: Recorded, object_id: str, codes: dict[str, str]) -> Recorded:
    """The same with other codes printed on the box, however they were turned when they were read."""
    printed = {read_code(code, start): read_code(codes[code], start) for code in codes for start in range(4)}

    def renamed(table: pa.Table) -> pa.Table:
        names = {"code": [printed[str(code)] for code in table["code"].to_pylist()]}
        names["object_id"] = [object_id] * table.num_rows
        for name, values in names.items():
            at = table.schema.get_field_index(name)
            table = table.set_column(at, name, pa.array(values).cast(table.schema.field(name).type))
        return table

    return replace(session, markers_2d=renamed(session.markers_2d), markers_3d=renamed(session.markers_3d))


def test_sizes_and_places_of_markers_are_found(generated: Generated) -> None:
    session = generated(300)
    found = calibrate_boxes([session.recording])
    assert found.residual_px < 0.8
    (box,) = found.prototypes
    assert session.prototype is not None
    true = {face.code: face for face in session.prototype.faces}
    assert box.name == "Stella Artois"
    for face in box.faces:
        assert face.face == true[face.code].face
        assert face.side_m == pytest.approx(true[face.code].side_m, abs=0.001)
        np.testing.assert_allclose(face.centre, true[face.code].centre, atol=0.002)
        assert face.sigma_m is not None
        assert face.sigma_m < 0.003


def test_an_unknown_box_is_calibrated_too(generated: Generated) -> None:
    session = generated(200)
    (box,) = calibrate_boxes([session.recording], CalibrationParameters(known=())).prototypes
    assert box.name == "o2"
    assert {face.face for face in box.faces} == {"+x", "-y", "+z"}
    assert box.size_m == pytest.approx((0.1524,) * 3, abs=0.002)


def test_without_a_polygon_the_boxes_tell_where_the_table_is(generated: Generated) -> None:
    session = generated(200)
    found = calibrate_boxes([replace(session.recording, polygon=np.empty((0, 3)))])
    assert session.table is not None
    cosine = found.tables[0].rotation[:, 2] @ session.table.rotation[:, 2]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 0.5


def test_several_recordings_are_calibrated_together(generated: Generated) -> None:
    parts = [generated(120, noise_px=0.3), generated(100, noise_px=0.1)]
    found = calibrate_boxes([part.recording for part in parts])
    assert len(found.tables) == 2
    assert len(found.prototypes) == 1


def test_a_recording_that_shows_no_box_is_no_hindrance(generated: Generated) -> None:
    session = generated(120)
    nothing = Recording(session.markers_2d.slice(0, 0))
    found = calibrate_boxes([nothing, session.recording])
    alone = calibrate_boxes([session.recording])
    assert len(found.tables) == 1
    assert found.prototypes == alone.prototypes


def marks_of(recording: Recording) -> pa.Table:
    return recording.markers_2d


def test_of_many_recordings_enough_are_used_of_every_box(generated: Generated) -> None:
    one = generated(60).recording
    other = shown_as(generated(60), "o3", ANOTHER).recording
    many = [one] * 50
    many[7], many[31] = other, other
    assert sufficient(many, marks_of, 100) == many
    few = sufficient(many, marks_of, 4)
    assert sum(r is one for r in few) == 4
    assert sum(r is other for r in few) == 2
    assert sufficient(many, marks_of, 4) == few


def test_those_used_lie_all_over_the_sequence(generated: Generated) -> None:
    base = generated(60).recording
    many = [replace(base) for _ in range(200)]
    places = [next(i for i, m in enumerate(many) if m is r) for r in sufficient(many, marks_of, 16)]
    assert places == sorted(places)
    assert max(np.diff([0, *places, 199])) <= 2.5 * 200 / 16


def test_misread_codes_do_not_make_faces(generated: Generated) -> None:
    session = generated(200)
    codes = session.markers_2d["code"].to_pylist()
    codes[5] = "1010101010101010101010101"
    at = session.markers_2d.schema.get_field_index("code")
    markers = session.markers_2d.set_column(at, "code", pa.array(codes))
    (box,) = calibrate_boxes([replace(session.recording, markers_2d=markers)]).prototypes
    assert len(box.faces) == 3


def test_a_box_seen_from_one_side_only_cannot_be_calibrated(generated: Generated) -> None:
    session = generated(60)
    one = session.markers_2d.filter(pc.field("order") == 0)
    with pytest.raises(InputError, match="two or three faces"):
        calibrate_boxes([replace(session.recording, markers_2d=one, markers_3d=None)])


@pytest.mark.parametrize("px", [3.0, 30.0])
def test_marks_far_off_what_the_detector_promises_measure_nothing(generated: Generated, px: float) -> None:
    """Whatever is said is said as an error: no box fits, and nothing is printed beside it."""
    session = generated(120, noise_px=px)
    parameters = CalibrationParameters(noise=SUBPIXEL)
    with pytest.raises(InputError):
        calibrate_boxes([session.recording], parameters)


def test_frames_in_which_a_box_is_carried_do_not_count(generated: Generated) -> None:
    rng = np.random.default_rng(3)
    lift = np.zeros((300, 3))
    lift[100:, 2] = 0.1 + np.cumsum(rng.normal(0, 0.005, 200))
    moved, still = generated(300, lift=lift), generated(300)
    assert moved.prototype is not None
    true = {face.code: face for face in moved.prototype.faces}
    (box,) = calibrate_boxes([moved.recording]).prototypes
    first = pc.field("frame") < 100
    (only,) = calibrate_boxes(
        [Recording(still.markers_2d.filter(first), still.markers_3d.filter(first), still.polygon)]
    ).prototypes
    for face, alone in zip(box.faces, only.faces, strict=True):
        np.testing.assert_allclose(face.centre, true[face.code].centre, atol=0.003)
        np.testing.assert_allclose(face.centre, alone.centre, atol=0.001)


def test_a_box_that_never_rests_is_not_measured_and_stays_beside_those_that_are(generated: Generated) -> None:
    lift = np.zeros((120, 3))
    lift[:, 2] = 0.2 + 0.1 * np.sin(np.arange(120) / 7)
    carried = generated(120, lift=lift)
    with pytest.raises(InputError, match="standing on the table"):
        calibrate_boxes([carried.recording])
    # the same as another box
    resting = generated(120)
    other = shown_as(carried, "o9", ANOTHER)
    found = calibrate_boxes([resting.recording, other.recording]).prototypes
    assert [box.name for box in found] == ["Stella Artois", "Pepsi"]
    assert all(face.sigma_m is not None for face in found[0].faces)
    assert all(face.sigma_m is None for face in found[1].faces)
    (alone,) = calibrate_boxes([resting.recording]).prototypes
    assert found[0].size_m == pytest.approx(alone.size_m)


def test_a_known_box_of_one_visible_face_stays_as_it_is_known(generated: Generated) -> None:
    resting = generated(120)
    largest = resting.markers_2d.filter(pc.field("order") == 0)
    one = replace(resting, markers_2d=largest, markers_3d=resting.markers_3d.slice(0, 0))
    found = calibrate_boxes([resting.recording, shown_as(one, "o9", ANOTHER).recording]).prototypes
    assert found[1] == PEPSI


def test_a_camera_that_was_moved_sees_the_table_from_two_places(generated: Generated) -> None:
    session = generated(200)
    elsewhere = Rigid(matrix_about_z(np.array(0.1)), np.array([0.05, 0.02, 0.1])) @ TABLE
    rows = [(0, TABLE), (120, elsewhere)]
    names = ("qx", "qy", "qz", "qw", "origin_x", "origin_y", "origin_z")
    plane = pa.Table.from_pylist(
        [
            {"frame": frame} | dict(zip(names, [*table.quaternion, *table.translation], strict=True))
            for frame, table in rows
        ]
    )
    pieces = recordings_on(plane, session.markers_2d)
    assert [pc.min_max(piece.markers_2d["frame"]).as_py() for piece in pieces] == [
        {"min": 0, "max": 119},
        {"min": 120, "max": 199},
    ]
    for piece, (_, table) in zip(pieces, rows, strict=True):
        assert np.abs(table.inverse().apply(piece.polygon)[:, 2]).max() < 1e-9
    (box,) = calibrate_boxes(pieces[:1]).prototypes
    assert box.size_m == pytest.approx((0.1524,) * 3, abs=0.002)


def test_calibrated_prototypes_can_be_saved(generated: Generated) -> None:
    (box,) = calibrate_boxes([generated(120).recording]).prototypes
    assert BoxPrototype.from_dict(box.to_dict()) == box
