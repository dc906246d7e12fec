"""The geometry of a box comes out of a recording of it, whatever the prototype tables say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from ecat.errors import InputError
from ecat.model.prototype import BoxPrototype
from ecat.stages.calibrate import CalibrationParameters, Recording, calibrate_boxes
from tests.stages.recorded import Recorded

Generated = Callable[..., Recorded]


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


def test_calibrated_prototypes_can_be_saved(generated: Generated) -> None:
    (box,) = calibrate_boxes([generated(120).recording]).prototypes
    assert BoxPrototype.from_dict(box.to_dict()) == box
