"""Demonstrations for VoxSim's teaching scene: the structure of the file that came with it, from a session's poses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats import export, import_source
from ecat.formats.robotics.demonstrations import ACTIONS, FORMAT, action_of, blocks_of, corners, dump
from ecat.formats.robotics.scene import Things, things_of
from ecat.model import Event, ProjectManifest
from ecat.model.annotation import Role
from ecat.process import process_session
from ecat.sample import GroundTruth
from ecat.store import Session, create_project, open_session
from tests.formats.robotics.scenes import bare, exported, made

Points = NDArray[np.float64]


def read(path: Path) -> dict[str, list[dict[str, list[list[float]]]]]:
    return json.loads(path.read_bytes())


def shape(value: Any) -> Any:
    """What a JSON value is made of."""
    if isinstance(value, dict):
        return {key: shape(inner) for key, inner in value.items()}
    if isinstance(value, list):
        kinds = [shape(inner) for inner in value]
        assert all(kind == kinds[0] for kind in kinds) or all(isinstance(kind, list) for kind in kinds)
        return kinds[:1]
    return type(value).__name__


def test_the_file_that_the_scene_came_with_is_written_as_it_is(shared: Path) -> None:
    data = (shared / "demonstrations_ch5/survey_3d/all_demos.json").read_bytes()
    assert dump(json.loads(data)) == data
    assert list(json.loads(data)) == list(ACTIONS)


def test_a_session_has_the_structure_of_that_file(session: Session, out: Path, shared: Path) -> None:
    exported(FORMAT, session, out)
    theirs = read(shared / "demonstrations_ch5/survey_3d/all_demos.json")
    assert shape(read(out)["Next"]) == shape(theirs["Next"])


def test_starts_and_way_are_those_of_the_blocks(filmed: tuple[Session, GroundTruth], out: Path) -> None:
    session, truth = filmed
    exported(FORMAT, session, out, centre="none", tolerance_m="0.01")
    (event,) = (event for event in session.layer("main").events if event.parent is None)
    theme, landmark = (
        truth.object_ids.index(r.target) for r in event.roles if r.name in {"Theme", "Landmark"}
    )
    ((demonstration,),) = read(out).values()
    start, end = event.segments[0].start_frame, event.segments[0].end_frame
    way = truth.position[theme, start:end, :2]
    assert demonstration["start_config"] == [way[0].tolist(), truth.position[landmark, start, :2].tolist()]
    line = np.array([demonstration["start_config"][0], *demonstration["action_storage"]])
    assert line[-1].tolist() == way[-1].tolist()
    assert distance(way, line).max() <= 0.01


def test_the_origin_is_the_middle_of_the_table(session: Session, tmp_path: Path) -> None:
    exported(FORMAT, session, tmp_path / "a", centre="none")
    exported(FORMAT, session, tmp_path / "b")
    plain, centred = (np.array(read(tmp_path / name)["Next"][0]["start_config"]) for name in "ab")
    shift = plain - centred
    np.testing.assert_allclose(shift[0], shift[1])
    assert np.abs(centred).max() < np.abs(plain).max()


def distance(points: Points, line: Points) -> Points:
    """From each point to the nearest of a line (n, 2)."""
    starts, along = line[:-1], np.diff(line, axis=0)
    t = np.einsum("psd,sd->ps", points[:, None] - starts, along) / np.maximum((along**2).sum(1), 1e-18)
    nearest = starts + np.clip(t, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=-1).min(1)


@given(
    arrays(np.float64, st.tuples(st.integers(2, 40), st.just(2)), elements=st.floats(-1, 1)),
    st.floats(0.001, 0.5),
)
def test_a_reduced_line_stays_near_and_keeps_its_ends(way: Points, tolerance: float) -> None:
    kept = corners(way, tolerance)
    assert kept[0].tolist() == way[0].tolist()
    assert kept[-1].tolist() == way[-1].tolist()
    assert distance(way, kept).max() <= tolerance + 1e-9
    assert {tuple(point) for point in kept.tolist()} <= {tuple(point) for point in way.tolist()}


def test_a_straight_way_has_no_corners() -> None:
    way = np.linspace([0.0, 0.0], [1.0, 2.0], 50)
    assert corners(way, 0.001).tolist() == [[0, 0], [1, 2]]


@pytest.mark.parametrize(
    ("kind", "text", "action"),
    [
        ("slide_away", "", "Away"),
        ("move_toward", "", "Closer"),
        ("", "Slide Shell past Stella Artois ", "Past"),
        ("", "Slide A around B", "Around"),
        ("slide-next", "", "Next"),
        ("roll", "it rolls", "roll"),
        ("", "hm", "other"),
    ],
)
def test_actions_go_by_the_scene_s_names(kind: str, text: str, action: str) -> None:
    assert action_of(Event(id="a1", type=kind, text=text)) == action


def test_who_moves_is_told_by_roles_then_by_the_text_then_by_the_way(session: Session) -> None:
    things, ids = things_of(session), ("o2", "o3")
    stands, moves = np.zeros((5, 1, 2)), np.linspace(0, 1, 5)[:, None, None] * np.ones((1, 1, 2))
    places = np.concatenate([stands, moves], 1)
    roles = (Role(name="Theme", target="o2"), Role(name="Landmark", target="o3"))
    assert blocks_of(Event(id="a", roles=roles), ids, things, places) == ("o2", "o3")
    assert blocks_of(Event(id="a", text="Slide Shell past stella artois"), ids, things, places) == (
        "o2",
        "o3",
    )
    assert blocks_of(Event(id="a", text="it moves"), ids, things, places) == ("o3", "o2")
    assert blocks_of(Event(id="a"), ("o2", "o3", "o9"), Things(), np.zeros((5, 3, 2))) is None


def test_sessions_are_joined_as_if_they_had_been_one_file(tmp_path: Path) -> None:
    project = tmp_path / "project"
    create_project(project, ProjectManifest(name="p", created="2024-01-01T00:00:00"))
    made(project / "one", seed=1, actions=("past",), pixels=False)
    made(project / "two", seed=2, actions=("next", "past"), pixels=False)
    export(project, tmp_path / "all.json", format="voxsim-demonstrations")
    single: list[dict[str, Any]] = []
    for name in ("one", "two"):
        export(project / name, tmp_path / f"{name}.json", format="voxsim-demonstrations")
        single.append(read(tmp_path / f"{name}.json"))
    expected = {"Past": single[0]["Past"] + single[1]["Past"], "Next": single[1]["Next"]}
    assert (tmp_path / "all.json").read_bytes() == dump(expected)


def test_a_session_without_poses_or_demonstrations_is_refused(
    session: Session, tmp_path: Path, out: Path
) -> None:
    with pytest.raises(NotFoundError):
        exported(FORMAT, bare(tmp_path / "s"), out)
    with pytest.raises(NotFoundError, match="machine"):
        exported(FORMAT, session, out, layer="machine")


@pytest.mark.slow
def test_the_real_recordings_become_demonstrations(shared: Path, tmp_path: Path) -> None:
    import_source(shared / "ecat_kinect/SlideAway/Session1", tmp_path / "s")
    process_session(tmp_path / "s")
    told = exported(FORMAT, open_session(tmp_path / "s"), tmp_path / "out.json")
    found = read(tmp_path / "out.json")
    assert {action: len(items) for action, items in found.items()} == {"Away": 18}
    # the nineteenth event: a block was hidden all the while
    assert [line for line in told if "left behind" in line] == [
        "event a8 was left behind: a block was not seen in it"
    ]
    for demonstration in found["Away"]:
        mover, other = np.array(demonstration["start_config"])
        end = np.array(demonstration["action_storage"][-1])
        assert np.linalg.norm(end - other) > np.linalg.norm(mover - other)
