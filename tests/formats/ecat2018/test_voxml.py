"""VoxML entries of objects."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError
from ecat.formats.ecat2018.voxml import (
    Embodiment,
    Habitat,
    Lex,
    ObjectType,
    VoxmlEntry,
    read_voxml,
    write_voxml,
)

words = st.text("abcXYZ[]()+-<>&\"'0123456789 ", min_size=1).map(str.strip).filter(bool)
several = st.lists(words, max_size=3).map(tuple)
bindings = st.lists(st.tuples(words, words), max_size=3).map(tuple)
entries = st.builds(
    VoxmlEntry,
    st.builds(Lex, st.none() | words, several),
    st.builds(ObjectType, st.none() | words, several, st.none() | words, several, several),
    st.builds(Habitat, bindings, bindings),
    several,
    st.builds(Embodiment, st.none() | words, st.none() | st.booleans()),
)


@pytest.fixture
def table(shared: Path) -> Path:
    return shared / "ecat_program" / "square_table.xml"


def test_the_shipped_table(table: Path) -> None:
    entry = read_voxml(table)
    assert entry.lex == Lex("table", ("physobj", "artifact"))
    assert entry.type == ObjectType("sheet[1]", ("surface[1]", "leg[2]+"), "Flat", ("Y",), ("XY", "YZ"))
    assert entry.habitat.intrinsic[0] == ("UP", "align(Y,E_y)")
    assert entry.habitat.intrinsic[2] == ("CONSTR[1]", "Y << Z, Y << X")
    assert entry.affordances[1] == "H[3]->[put(x,on([1]))]support([1],x)"
    assert entry.embodiment == Embodiment("agent", movable=True)
    assert entry.unknown == ()
    assert entry.used_by_ecat
    assert read_voxml(write_voxml(entry)) == entry


@given(entries)
def test_reading_a_written_entry_gives_it_back(entry: VoxmlEntry) -> None:
    assert read_voxml(write_voxml(entry)) == entry


def test_unknown_elements_are_kept_where_they_stood() -> None:
    entry = read_voxml(
        b'<VoxML><Entity Type="Object"/><Lex><Pred>cup</Pred><Note a="1">x<b/></Note></Lex></VoxML>'
    )
    assert entry.unknown == (("", '<Entity Type="Object"/>'), ("Lex", '<Note a="1">x<b/></Note>'))
    assert read_voxml(write_voxml(entry)) == entry


def test_ecat_skips_an_entry_without_predicate_type_or_concavity() -> None:
    """Trap: only these three are ever used, and an entry that lacks one is skipped without a word."""
    whole = VoxmlEntry(Lex("a", ("b",)), ObjectType(concavity="Flat"))
    assert whole.used_by_ecat
    for partial in (
        VoxmlEntry(Lex(None, ("b",)), whole.type),
        VoxmlEntry(Lex("a"), whole.type),
        VoxmlEntry(whole.lex),
    ):
        assert not partial.used_by_ecat


@pytest.mark.parametrize(
    ("document", "told"),
    [
        (b"<Voxml/>", "the root is <Voxml>"),
        (
            b"<VoxML><Embodiment><Movable>perhaps</Movable></Embodiment></VoxML>",
            "'perhaps' is neither true nor",
        ),
        (b"<VoxML><Habitat><Intrinsic><Intr Name='UP'/></Intrinsic></Habitat></VoxML>", "attribute Value is"),
    ],
)
def test_what_is_no_entry_is_refused(document: bytes, told: str) -> None:
    with pytest.raises(FormatError, match="line 1") as error:
        read_voxml(document)
    assert told in error.value.where
