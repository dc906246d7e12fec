"""Coding schemes are found by name: in the session, in its project, or built in."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecat.errors import ExistsError, FormatError, NotFoundError, UsageError
from ecat.model import CodingScheme, Constraint, PredicateType, ProjectManifest, Relation
from ecat.model.annotation import Argument
from ecat.model.scheme import BLOCKS_SCHEME, BUILT_IN_SCHEMES, ECAT_2018_SCHEME
from ecat.store import Session, create_project
from ecat.store.schemes import (
    find_scheme,
    read_scheme,
    scheme_names,
    scheme_or_default,
    scheme_places,
    write_scheme,
)
from ecat.store.xml import scheme_from_xml, scheme_to_xml
from tests.store.sessions import layer, make


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project of one session."""
    create_project(tmp_path / "project", ProjectManifest(name="p", created="2020-01-01T00:00:00"))
    make(tmp_path / "project" / "session")
    return tmp_path / "project"


@pytest.mark.parametrize("name", BUILT_IN_SCHEMES)
def test_built_in_schemes_need_no_file(session: Session, name: str) -> None:
    scheme = find_scheme(session.path, name)
    assert scheme.name == name
    assert scheme_from_xml(scheme_to_xml(scheme), name=name) == scheme


def test_the_keys_of_a_scheme_are_different() -> None:
    keys = [kind.key for kind in BLOCKS_SCHEME.event_types]
    assert len(set(keys)) == len(keys)
    assert {kind.tier for kind in BLOCKS_SCHEME.event_types} == {tier.name for tier in BLOCKS_SCHEME.tiers}


def test_the_nearest_file_counts(project: Path) -> None:
    session = project / "session"
    session_place, project_place = scheme_places(session)
    assert (session_place, project_place) == (session / "annotations", project)
    write_scheme(CodingScheme(name="mine", version="project"), project / "mine.scheme.xml")
    assert find_scheme(session, "mine").version == "project"
    write_scheme(CodingScheme(name="mine", version="session"), session / "annotations" / "mine.scheme.xml")
    assert find_scheme(session, "mine").version == "session"
    assert find_scheme(project, "mine").version == "project"
    assert scheme_names(session) == sorted({"mine", *BUILT_IN_SCHEMES})


def test_a_name_that_nobody_has_is_an_error_that_names_the_others(session: Session) -> None:
    for name in ("none", "../secret", ""):
        with pytest.raises(NotFoundError, match="cannot find the coding scheme") as caught:
            find_scheme(session.path, name)
        assert "blocks, ecat-2018" in caught.value.where
    assert scheme_or_default(session.path, "none") is ECAT_2018_SCHEME


def test_a_file_is_not_overwritten_unasked(tmp_path: Path) -> None:
    path = tmp_path / "annotations" / "mine.scheme.xml"
    write_scheme(CodingScheme(name="mine"), path)
    with pytest.raises(ExistsError, match="cannot write"):
        write_scheme(CodingScheme(name="mine", version="2"), path)
    write_scheme(CodingScheme(name="mine", version="2"), path, overwrite=True)
    assert read_scheme(path).version == "2"
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    with pytest.raises(UsageError, match="cannot write scheme"):
        write_scheme(CodingScheme(name="a/b"), path, overwrite=True)


def test_what_is_no_scheme_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.scheme.xml"
    path.write_text("<annotation/>")
    with pytest.raises(FormatError):
        read_scheme(path)


def test_the_scheme_of_a_layer_decides_which_facts_end_each_other(session: Session) -> None:
    lies = Constraint(kind="EXCLUSIVE", predicates="UP,DOWN")
    predicates = (PredicateType(name="UP", arity=1), PredicateType(name="DOWN", arity=1))
    write_scheme(
        CodingScheme(name="mine", predicates=predicates, constraints=(lies,)),
        session.path / "annotations" / "mine.scheme.xml",
    )
    facts = tuple(
        Relation(predicate=name, start_frame=frame, arguments=(Argument(target="o1"),))
        for name, frame in (("UP", 3), ("DOWN", 7))
    )
    from dataclasses import replace

    for scheme, end in (("", None), ("mine", 7)):
        with session.write() as commit:
            commit.put_layer(replace(layer(), scheme=scheme, relations=facts))
        rows = {row["predicate"]: row["end_frame"] for row in session.relations.to_arrow().to_pylist()}
        assert rows == {"UP": end, "DOWN": None}
