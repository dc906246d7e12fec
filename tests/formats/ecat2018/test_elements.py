"""Attributes, numbers and facts that elements have in common."""

from __future__ import annotations

import pytest
from lxml import etree

from ecat.errors import FormatError, LimitError
from ecat.formats.ecat2018.elements import (
    MAX_ATTRIBUTES,
    attribute_facts,
    attributes_of,
    fact,
    frame_number,
    kept,
    kept_attributes,
    predicate_of,
    small_number,
)


class TestNumbers:
    @pytest.mark.parametrize("said", ["0", "-1", "2147483647", "-2147483648", "007"])
    def test_a_whole_number_of_32_bits(self, said: str) -> None:
        assert frame_number(said, "", 1) == int(said)

    @pytest.mark.parametrize("said", [None, "", "1.5", "2147483648", "٣", "1e3", " 1", "9" * 10_000])
    def test_anything_else_is_refused_with_its_line(self, said: str | None) -> None:
        with pytest.raises(FormatError, match="cannot import it") as caught:
            frame_number(said, "cannot import it", 17)
        assert caught.value.where.startswith("line 17: expected a whole number of 32 bits, found ")
        assert len(caught.value.where) < 120

    @pytest.mark.parametrize(
        ("said", "number"),
        [("5", 5), ("12", 12), ("²", None), ("", None), (None, None), ("99999", None), ("-1", None)],
    )
    def test_a_small_number_or_none(self, said: str | None, number: int | None) -> None:
        assert small_number(said) == number


class TestAttributes:
    def test_thousands_of_them_are_refused_at_once(self) -> None:
        said = "<a {}/>".format(" ".join(f'x{i}="1"' for i in range(100 * MAX_ATTRIBUTES)))
        with pytest.raises(LimitError, match="cannot import it") as caught:
            attributes_of(etree.fromstring(said), "cannot import it")
        assert caught.value.where == "line 1: 100,000 attributes, at most 1,000 are read"

    def test_those_of_other_namespaces_are_not_ours(self) -> None:
        assert attributes_of(etree.fromstring('<a xmlns:x="u" b="1" x:c="2" d="3"/>'), "") == {
            "b": "1",
            "d": "3",
        }

    def test_the_usual_ones_in_their_order_need_no_facts(self) -> None:
        assert attribute_facts({"a": "1", "b": "2"}, ("a", "b"), ("a", "b")) == []

    @pytest.mark.parametrize("said", [{"b": "2", "a": "1"}, {"a": "1"}, {"x": "3", "a": "1", "b": "2"}, {}])
    def test_facts_restore_what_was_said(self, said: dict[str, str]) -> None:
        facts = tuple(attribute_facts(said, ("a", "b"), ("a", "b")))
        assert kept_attributes({"a": "1", "b": "2"}, facts) == list(said.items())


def test_a_fact_is_kept_under_the_format_s_name() -> None:
    assert fact("text", "1.0").key == "ecat-2018:text"
    assert kept((fact("a", "1"), fact("b", "")), "b") == ""
    assert kept((), "b") is None


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("STAND(X)", ("STAND", False)),
        ("ON(X,Y)", ("ON", False)),
        ("ON(Y,X)", ("ON", True)),
        ("PART_OF", ("PART_OF", False)),
        ("ON(X, Y)", ("ON(X, Y)", False)),
        ("", ("", False)),
    ],
)
def test_forms_of_predicates(said: str, meant: tuple[str, bool]) -> None:
    assert predicate_of(said) == meant
