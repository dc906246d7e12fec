"""The body scheme says how to read a rig file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError
from ecat.formats.ecat2018.body_scheme import (
    KINECT_V2,
    BodyScheme,
    Joint,
    read_body_scheme,
    write_body_scheme,
)


def test_the_real_schemes_are_the_built_in_one(shared: Path) -> None:
    """Trap: joints stand in alphabetical order, values among blanks and comments, loose text between."""
    paths = list((shared / "ecat_kinect").glob("*/*/bodyScheme.xml"))
    assert len(paths) == 3
    for path in paths:
        assert read_body_scheme(path) == KINECT_V2


def test_joint_ids_are_places_in_the_flat_lists() -> None:
    names = [joint.name for joint in KINECT_V2.joints]
    assert len(names) == 25
    assert [names[i] for i in (0, 3, 7, 11, 20, 24)] == [
        *("SpineBase", "Head", "HandLeft", "HandRight", "SpineShoulder", "ThumbRight"),
    ]
    assert len(KINECT_V2.bones) == 24


def test_the_unused_time_path_of_one_session_is_read() -> None:
    """Trap: SlideAround/Session1 has a ``timeFromBeginPath`` that the others lack."""
    scheme = replace(KINECT_V2, time_from_begin_path="Timestamp/@timeFromBegin")
    assert read_body_scheme(write_body_scheme(scheme)) == scheme


@given(
    st.lists(st.text("abcXYZ &<>'\"", min_size=1), min_size=1, max_size=12, unique=True).flatmap(
        lambda names: st.tuples(
            st.just(tuple(Joint(name, name[::-1]) for name in names)),
            st.lists(st.tuples(*[st.integers(0, len(names) - 1)] * 2)).map(tuple),
        )
    )
)
def test_reading_a_written_scheme_gives_it_back(
    parts: tuple[tuple[Joint, ...], tuple[tuple[int, int], ...]],
) -> None:
    scheme = BodyScheme(*parts)
    assert read_body_scheme(write_body_scheme(scheme)) == scheme


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (b"Subject/@id", b"//*[last()]", "is not a path of element names"),
        (b"Subject/@id", b"../Subject", "is not a path of element names"),
        (b"Subject/@id", b" ", "is not a path of element names"),
        (b'"flat"', b'"node"', "only XML with flat lists"),
        (b">xml<", b">json<", "only XML with flat lists"),
        (b'id="24"', b'id="23"', "two joints share"),
        (b'id="24"', b'id="25"', "not an integer from 0 to 24"),
        (b'to="19"', b'to="99"', "not an integer from 0 to 24"),
        (b"<rigNoPath>Subject/@id</rigNoPath>", b"", "<rigNoPath> is missing"),
        (b"rigFormat>", b"rig>", "expected <rigFormat>"),
    ],
)
def test_schemes_that_cannot_be_followed_are_refused(old: bytes, new: bytes, told: str) -> None:
    written = write_body_scheme(KINECT_V2)
    assert old in written
    with pytest.raises(FormatError, match="line") as error:
        read_body_scheme(written.replace(old, new))
    assert told in error.value.where


def test_a_flood_of_joints_is_refused() -> None:
    joints = tuple(Joint(f"j{i}") for i in range(128))
    with pytest.raises(FormatError, match="128 joints"):
        read_body_scheme(write_body_scheme(BodyScheme(joints, ())))
