"""ECAT's options: predicates and constraints."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError
from ecat.formats.ecat2018.options import (
    DetectionMode,
    Exclusive,
    Interpolation,
    Options,
    PredicateForm,
    RigView,
    Unique,
    read_options,
    write_options,
)
from ecat.model.scheme import ECAT_2018_SCHEME

names = st.text("ABCXYZ_0123456789", min_size=1)
forms = st.builds(PredicateForm, names, st.sampled_from([(1,), (1, 2), (2, 1)]))
uniques = forms.flatmap(
    lambda form: st.builds(
        Unique, st.just(form), st.lists(st.sampled_from(form.slots), unique=True).map(tuple)
    )
)
options = st.builds(
    Options,
    st.sampled_from(get_args(DetectionMode)),
    st.lists(forms).map(tuple),
    st.none() | names,
    st.lists(st.tuples(names, st.sampled_from(get_args(Interpolation)))).map(tuple),
    st.lists(forms).map(tuple),
    st.lists(uniques | st.builds(Exclusive, st.lists(forms).map(tuple))).map(tuple),
    st.booleans(),
    st.sampled_from(get_args(RigView)),
)


@pytest.fixture
def real(shared: Path) -> Path:
    return shared / "ecat_program" / "option.txt"


def test_the_shipped_file_comes_back_byte_for_byte(real: Path) -> None:
    assert write_options(read_options(real)) == real.read_bytes()


def test_the_shipped_predicates_and_constraints_are_those_of_the_built_in_scheme(real: Path) -> None:
    read = read_options(real)
    listed = [(f.name, len(f.slots), "object") for f in read.object_predicates]
    listed += [(f.name, len(f.slots), "event") for f in read.event_predicates]
    assert listed == [(p.name, p.arity, p.target) for p in ECAT_2018_SCHEME.predicates]
    assert [str(constraint) for constraint in read.constraints] == [
        "UNIQUE=LOOK_AT(X,#Y)",
        "UNIQUE=POINT_AT(X,#Y)",
        "EXCLUSIVE=STAND(X) # SIT(X) # WALK(X) # RUN(X) # LIE(X) # CROUCH(X) # KNEEL(X)",
    ]


def test_the_shipped_modes(real: Path) -> None:
    read = read_options(real)
    assert (read.detection_mode, read.show_markers, read.show_rig) == ("OVERWRITE", True, "SHOW_UPPER")
    assert dict(read.interpolation_modes) == {"Rig": "LINEAR", "Rectangle": "LINEAR", "Glyph": "LINEAR"}


@given(options)
def test_reading_written_options_gives_them_back(chosen: Options) -> None:
    written = write_options(chosen)
    assert read_options(written) == chosen
    assert b"\n" not in written


def test_missing_and_null_members_take_ecat_s_defaults() -> None:
    """Trap: the defaults in the code differ from the shipped values, and fill null members only."""
    empty = read_options(b'<Options xmlns="http://schemas.datacontract.org/2004/07/Annotator"/>')
    assert empty == Options()
    assert (empty.detection_mode, empty.show_rig) == ("ADD_SEPARATE", "SHOW_ALL")
    assert dict(empty.interpolation_modes)["Glyph"] == "LEFT_COPY"


def test_swapped_slots_are_printed_in_their_order() -> None:
    assert str(PredicateForm("SUPPORT", (2, 1))) == "SUPPORT(Y,X)"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (b"OVERWRITE", b"SOMETIMES", "'SOMETIMES' is none of ADD_SEPARATE"),
        (b"<size>2</size>", b"<size>1</size>", "not those of 1 arguments"),
        (b"<size>2</size>", b"<size>two</size>", "'two' is not an integer"),
        (b"UniqueConstraint", b"FuzzyConstraint", "unknown constraint 'FuzzyConstraint'"),
        (b"<predicate>SUBEVENT</predicate>", b"", "predicate> is missing"),
        (b"<a:Key>Rig</a:Key>", b"", "Key> is missing"),
        (b"2004/07", b"2004/08", "not <Options>"),
    ],
)
def test_values_that_mean_nothing_are_refused_with_their_place(
    real: Path, old: bytes, new: bytes, told: str
) -> None:
    data = real.read_bytes()
    assert old in data
    with pytest.raises(FormatError, match="line 1") as error:
        read_options(data.replace(old, new, 1))
    assert told in error.value.where
