"""VoxML entries, read back by the reader of ECAT's own."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecat.errors import NotFoundError
from ecat.formats.ecat2018.voxml import VoxmlEntry, read_voxml
from ecat.formats.robotics.voxml import FORMAT
from ecat.model import AnnotatedObject, Layer, Manifest
from ecat.store import Draft, Session, create_session
from tests.formats.robotics.scenes import bare, exported


@pytest.fixture(scope="module")
def entries(session: Session, tmp_path_factory: pytest.TempPathFactory) -> dict[str, VoxmlEntry]:
    out = tmp_path_factory.mktemp("voxml") / "out"
    exported(FORMAT, session, out)
    return {path.name: read_voxml(path) for path in sorted(out.iterdir())}


def test_every_kind_of_thing_has_an_entry_that_ecat_reads(entries: dict[str, VoxmlEntry]) -> None:
    assert set(entries) == {"shell.xml", "stella_artois.xml", "table.xml"}
    assert all(entry.used_by_ecat and not entry.unknown for entry in entries.values())
    assert [entry.lex.pred for entry in entries.values()] == ["shell", "stella_artois", "table"]


def test_a_box_is_a_prism_that_stands_upright_and_is_smaller_than_who_handles_it(
    entries: dict[str, VoxmlEntry],
) -> None:
    box = entries["shell.xml"]
    assert box.type.head == "rectangular_prism[1]"
    assert box.type.rotational_symmetry == ("X", "Y", "Z")
    assert ("UP", "align(Y,E_Y)") in box.habitat.intrinsic
    assert box.embodiment.scale == "<agent"


def test_only_what_was_seen_to_move_is_movable(entries: dict[str, VoxmlEntry]) -> None:
    moved = {name: entry.embodiment.movable for name, entry in entries.items()}
    assert moved["table.xml"] is None
    assert sorted(str(value) for name, value in moved.items() if name != "table.xml") == ["None", "True"]


def test_affordances_are_what_was_done(session: Session, entries: dict[str, VoxmlEntry]) -> None:
    (whole,) = (event for event in session.layer("main").events if event.parent is None)
    roles = {role.name: role.target for role in whole.roles}
    files = {"o2": "shell.xml", "o3": "stella_artois.xml"}
    theme, landmark = entries[files[roles["Theme"]]], entries[files[roles["Landmark"]]]
    assert "H->[slide_next(x,[1],y)]" in theme.affordances
    assert "H->[grasp(x,[1])]" in theme.affordances
    assert landmark.affordances == ("H->[slide_next(x,y,[1])]",)
    assert entries["table.xml"].affordances == ("H->[put(x,on([1]))]support([1],x)",)


def test_agents_and_sizes_stay_behind_by_name(session: Session, out: Path) -> None:
    told = exported(FORMAT, session, out)
    assert any("Performer 1 was left behind" in line for line in told)
    assert any("Shell: its size of 152 x 152 x 152 mm" in line for line in told)


def test_things_of_one_type_share_an_entry_and_unknown_shapes_are_told(tmp_path: Path, out: Path) -> None:
    cups = tuple(
        AnnotatedObject(id=f"o{k}", name=f"cup {k}", kind="rectangle", semantic_type="cup/mug")
        for k in range(2)
    )
    manifest = Manifest(name="s", created="2024-01-01T00:00:00")
    session = create_session(tmp_path / "s", Draft(manifest=manifest, layers=(Layer(objects=cups),)))
    told = exported(FORMAT, session, out)
    (entry,) = (read_voxml(path) for path in out.iterdir())
    assert entry.lex.pred == "cup_mug"
    assert entry.type.head is None
    assert told == ("cup_mug: nothing is known of its shape",)


def test_a_session_without_objects_is_refused(tmp_path: Path, out: Path) -> None:
    with pytest.raises(NotFoundError):
        exported(FORMAT, bare(tmp_path / "s"), out)
