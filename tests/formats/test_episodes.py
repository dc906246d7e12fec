"""What is exported as episodes: which stretches, at which moments, with which numbers, images and words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import EcatError, InputError, NotFoundError, UsageError
from ecat.formats.episode_plan import Plan
from ecat.formats.episodes import Episode, EpisodeOptions, clock_method, episodes_of, left_behind
from ecat.model import Event
from ecat.store import Session, open_session
from tests.formats.interchange.layers import Holding
from tests.formats.lerobot.recordings import NS, Action, Recording, make, pose


def episodes(session: Session, **options: Any) -> list[Episode]:
    return list(episodes_of(session, "label", EpisodeOptions(**options)))


def column(episode: Episode, name: str) -> list[float]:
    return episode.state[:, episode.state_names.index(name)].tolist()


def frames(values: Iterable[float]) -> list[int]:
    """Which frames these places of the first box are of."""
    return [round(value * 1000) for value in values]


def test_every_topmost_event_is_an_episode(tmp_path: Path) -> None:
    actions = (
        Action(start=30, end=40, text="second"),
        Action(start=5, end=15, text="first", parts=(("hold", 6, 8),)),
    )
    found = episodes(make(tmp_path, Recording(actions=actions)))
    assert [(e.task, e.type, e.event, e.index, e.session) for e in found] == [
        ("first", "slide", "a1", 0, "label"),
        ("second", "slide", "a0", 1, "label"),
    ]
    assert [(round(e.start_ns * 30 / NS), len(e)) for e in found] == [(5, 10), (30, 10)]


def test_a_tier_or_a_type_says_which_events_are_meant(tmp_path: Path) -> None:
    session = make(tmp_path, Recording())
    assert [e.task for e in episodes(session, tier="sub")] == ["hold", "move"]
    assert [e.task for e in episodes(session, type="move")] == ["move"]
    with pytest.raises(InputError, match="cannot make episodes of label"):
        episodes(session, type="push")


def test_a_whole_session_is_one_episode_with_all_its_events_as_subtasks(tmp_path: Path) -> None:
    [episode] = episodes(make(tmp_path, Recording()), episodes="session")
    assert (episode.event, episode.task, len(episode)) == ("", "Slide red past blue", 60)
    assert [(s.text, s.level) for s in episode.subtasks] == [
        ("Slide red past blue", 0),
        ("hold", 1),
        ("move", 1),
    ]


def test_moments_are_regular_whatever_the_camera_did(tmp_path: Path) -> None:
    [episode] = episodes(make(tmp_path, Recording(rate_hz=24.0)), episodes="session")
    assert set(np.diff(episode.times_ns).tolist()) <= {33_333_333, 33_333_334}
    # of 24 images a second some are shown twice, and the numbers are those of the image that is shown
    assert frames(column(episode, "red.x")) == episode.images["color"].tolist()
    assert episode.images["color"].tolist() == sorted(
        np.rint(np.arange(75) * 0.8 - 1e-6).astype(int).tolist()
    )
    assert episode.off_ns["color"] <= NS / 24 / 2 + 1000


def test_numbers_may_lie_on_a_line_between_frames(tmp_path: Path) -> None:
    [episode] = episodes(make(tmp_path, Recording(rate_hz=24.0)), episodes="session", clock="linear")
    x = column(episode, "red.x")
    assert np.diff(x)[:-2] == pytest.approx(0.0008, abs=1e-6)
    q = episode.state[:, [episode.state_names.index(f"red.q{a}") for a in "xyzw"]]
    assert np.linalg.norm(q, axis=1)[:-2] == pytest.approx(1, abs=1e-6)


def test_each_image_may_be_a_moment(tmp_path: Path) -> None:
    [episode] = episodes(make(tmp_path, Recording(rate_hz=24.0)), clock="images")
    assert episode.images["color"].tolist() == list(range(15, 45))
    assert frames(column(episode, "red.x")) == list(range(15, 45))
    assert episode.off_ns["color"] == 0


def test_without_a_clock_only_images_can_be_moments(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(clock=False))
    with pytest.raises(InputError, match="cannot make episodes") as raised:
        episodes(session)
    assert "clock=images" in raised.value.fix
    [episode] = episodes(session, clock="images")
    assert frames(column(episode, "red.x")) == list(range(15, 45))
    assert [(round(s.start_ns * 30 / NS), s.type) for s in episode.subtasks] == [(20, "hold"), (22, "move")]


def test_what_is_known_only_far_away_in_time_is_not_known(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(unknown=tuple(range(20, 40))))
    [episode] = episodes(session, gap_s=0.1)
    known = np.isfinite(episode.state).all(axis=1)
    assert known.tolist() == [15 + i < 20 or 15 + i >= 40 for i in range(30)]


@pytest.mark.parametrize(
    ("action", "names", "expected"),
    [
        ("next_pose", ("x", "y", "z", "qx", "qy", "qz", "qw"), pose(16, 0)),
        ("delta", ("dx", "dy", "dz", "rx", "ry", "rz"), (0.001, 0, 0, 0, 0, 0.02)),
    ],
)
def test_an_action_is_where_the_moved_box_is_next(
    tmp_path: Path, action: str, names: tuple[str, ...], expected: tuple[float, ...]
) -> None:
    [episode] = episodes(make(tmp_path, Recording()), action=action)
    assert episode.action_names == names
    assert episode.moved == "red"
    assert episode.action[0] == pytest.approx(expected, abs=1e-6)
    # the last one too: the recording goes on behind the event
    assert np.isfinite(episode.action).all()


def test_an_action_may_be_the_next_state_or_nothing(tmp_path: Path) -> None:
    session = make(tmp_path, Recording())
    [following] = episodes(session, action="next_state")
    assert following.action[:-1].tolist() == following.state[1:].tolist()
    [nothing] = episodes(session, action="none")
    assert nothing.action.shape == (30, 0)


def test_of_a_whole_session_the_action_follows_the_box_that_is_moved(tmp_path: Path) -> None:
    actions = (Action(start=10, end=20, theme="o2"), Action(start=30, end=40, theme="o1"))
    [episode] = episodes(make(tmp_path, Recording(actions=actions)), episodes="session")
    # until the first event is over it is the blue box, which stands at x = 0.5
    assert [round(float(x), 3) == 0.5 for x in episode.action[:, 0]] == [i < 20 for i in range(60)]
    assert episode.moved == ""


def test_without_a_role_the_box_that_moved_furthest_was_moved(tmp_path: Path) -> None:
    [episode] = episodes(make(tmp_path, Recording()), moved="Patient")
    assert episode.moved == "red"


def test_joints_are_in_the_frame_of_the_table_and_hands_are_closed_while_they_hold(tmp_path: Path) -> None:
    [episode] = episodes(make(tmp_path, Recording(joints=True)), gap_s=0.01)
    assert episode.state_names[14:] == (
        *(f"{joint}.{axis}" for joint in ("HandRight", "Head") for axis in "xyz"),
        "HandLeft.closed",
        "HandRight.closed",
    )
    assert episode.state[0, 14:17] == pytest.approx([0.15, 0.1, 0.0], abs=1e-6)
    assert np.isnan(column(episode, "Head.x")).tolist() == [i % 2 == 0 for i in range(30)]
    assert column(episode, "HandRight.closed") == [float(20 <= i < 30) for i in range(15, 45)]
    assert not any(column(episode, "HandLeft.closed"))


def test_the_state_has_only_what_was_asked_for(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(joints=True))
    [episode] = episodes(session, state="hands, joints", joints="Head")
    assert episode.state_names == ("Head.x", "Head.y", "Head.z", "HandLeft.closed", "HandRight.closed")
    with pytest.raises(UsageError, match="cannot make a state of box"):
        episodes(session, state="box")


def test_smoothed_poses_are_taken_where_there_are_such(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(tables=("poses", "poses_smooth")))
    assert episodes(session)[0].state.tolist() == episodes(session, poses="raw")[0].state.tolist()


def test_a_stream_that_began_late_has_no_images_before(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(views=("color", "depth"), late_s=0.5))
    [episode] = episodes(session, episodes="session", gap_s=0.1)
    shown = episode.images["depth"].tolist()
    assert shown[:12] == [-1] * 12
    assert shown[12:20] == [0, 0, 0, 0, 1, 2, 3, 4]


def test_who_acts_is_what_the_rig_says(tmp_path: Path) -> None:
    assert episodes(make(tmp_path, Recording(performer="Ada")))[0].performer == "Ada"
    assert episodes(make(tmp_path, Recording(name="two")))[0].performer == ""


def test_events_that_nobody_confirmed_are_none_and_it_is_said(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(status="proposed"))
    with pytest.raises(InputError, match="cannot make episodes") as raised:
        episodes(session)
    assert "1 proposed events" in raised.value.where


def test_an_event_without_a_moment_is_left_out_and_it_is_said(tmp_path: Path) -> None:
    actions = (Action(start=5, end=15), Action(start=20, end=20))
    plan = Plan(make(tmp_path, Recording(actions=actions)), "label", EpisodeOptions())
    assert len(plan) == 1
    assert plan.findings == ("event a1: there is no moment in it",)


def test_an_event_without_a_time_is_left_out_and_it_is_said(tmp_path: Path) -> None:
    session = make(tmp_path, Recording())
    layer = session.layer()
    whole = replace(layer, events=(*layer.events, Event(id="whole", type="session")))
    plan = Plan(Holding(session, whole), "label", EpisodeOptions())
    assert len(plan) == 1
    assert plan.findings == ("event whole: it has no time",)


def test_of_layers_the_agreed_one_counts_then_main_then_the_first_persons(tmp_path: Path) -> None:
    session = make(tmp_path, Recording())
    with session.write() as commit:
        commit.put_layer(replace(session.layer("main"), name="gold"))
    layers = {
        name: Plan(open_session(session.path), "l", EpisodeOptions(layer=name)).layer.name
        for name in ("", "main")
    }
    assert layers == {"": "gold", "main": "main"}
    with pytest.raises(NotFoundError) as raised:
        episodes(open_session(session.path), layer="anne")
    assert raised.value.where is not None
    assert "there is no layer anne; its layers are: " in raised.value.where
    assert all(name in raised.value.where for name in layers.values())
    assert raised.value.fix == "--option layer=NAME takes one of them; without it, that is gold"


def test_what_moments_have_no_place_for_is_said(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(views=("color", "depth")))
    with session.write() as commit:
        commit.put_layer(replace(session.layer("main"), name="anne"))
    session = open_session(session.path)
    assert list(left_behind(session, session.layer("main"), "the data set", ["color"])) == [
        "the data set has no place for: 4 roles",
        "streams left behind: depth",
        "layer main was written, not anne: --option layer=NAME takes another",
    ]


def test_a_recording_without_frames_is_one_typed_error(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(views=(), tables=(), n_frames=1, clock=False, actions=()))
    with session.write() as commit:
        commit.revise(lambda manifest: replace(manifest, n_frames=0))
    with pytest.raises(EcatError, match="cannot make episodes") as raised:
        episodes(open_session(session.path), clock="images", episodes="session")
    assert "no frames" in raised.value.where


def test_how_the_clock_was_made_is_on_record() -> None:
    assert clock_method(EpisodeOptions(clock="linear", fps=15)) == {
        "method": "linear",
        "fps": 15,
        "images": "nearest in time",
        "gap_s": 0.25,
    }
