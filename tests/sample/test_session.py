"""A sample session as a whole: what is played, what is said about it, and that it can be told again."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import UsageError
from ecat.geometry.transforms import Rigid
from ecat.model import Event, Relation
from ecat.model.annotation import Segment
from ecat.sample import ACTIONS, NOISELESS, SCHEME, sample_session
from ecat.sample.annotation import NEAR_M, ON_M, TOUCHING_M
from ecat.sample.body import FOREARM_M, HANDS, JOINTS, UPPER_ARM_M
from ecat.sample.motion import is_instance
from ecat.sample.scene import EDGE_M, TABLE_OUTLINE_M
from ecat.sample.truth import GroundTruth
from ecat.store import create_session, open_session
from tests.sample.samples import Sample


def offsets(truth: GroundTruth, move: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Positions (frames, 2) of the mover from the standing box, from the first grasp to the last release."""
    played = truth.moves[move]
    during = slice(played.carries[0].grasp, played.carries[-1].end)
    return truth.position[played.box, during, :2] - truth.position[played.landmark, during, :2]


# --------------------------------------------------------------------------------------------- the same


def test_the_same_seed_gives_the_same_session_bit_for_bit() -> None:
    (one, first), (two, second) = (sample_session(seed=7, actions=["past", "next"]) for _ in range(2))
    assert one.manifest == two.manifest
    assert one.layers == two.layers
    for name in one.tables:
        assert Sample(one, first).table(name).equals(Sample(two, second).table(name))
    assert first.position.tobytes() == second.position.tobytes()
    assert first.joints.tobytes() == second.joints.tobytes()


def test_other_seeds_give_other_sessions() -> None:
    drafts = [sample_session(seed=seed, actions=["around"]) for seed in range(4)]
    assert len({truth.position.tobytes() for _, truth in drafts}) == 4
    assert len({truth.scene.depth_from_table.translation.tobytes() for _, truth in drafts}) == 4


@pytest.mark.parametrize(
    ("actions", "told"), [(["roll"], "roll"), ([], "0 actions"), (["next"] * 101, "101 actions")]
)
def test_unknown_actions_are_refused(actions: list[str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        sample_session(seed=0, actions=actions)


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(UsageError, match="seed -1"):
        sample_session(seed=-1)


def test_a_session_can_be_stored_and_opened(sample: Sample, tmp_path: Path) -> None:
    create_session(tmp_path / "s", sample.draft)
    session = open_session(tmp_path / "s")
    assert session.name == sample.truth.name
    assert session.layer() == sample.layer
    for name in ("markers_2d", "markers_3d", "joints"):
        assert session.table(name).num_rows == sample.table(name).num_rows
    assert not session.has_table("poses")
    assert not any(stream.present for stream in session.manifest.streams)


def test_nothing_of_the_truth_is_in_the_session(sample: Sample) -> None:
    assert set(sample.draft.tables) == {"markers_2d", "markers_3d", "joints"}
    assert not sample.draft.manifest.prototypes
    assert not sample.draft.files


# ---------------------------------------------------------------------------------------- what is played


@pytest.mark.parametrize("action", ACTIONS)
def test_one_action_takes_five_to_eight_seconds(action: str) -> None:
    for seed in range(3):
        draft, truth = sample_session(seed=seed, actions=[action])
        assert 145 <= truth.n_frames <= 250
        assert [move.kind for move in truth.moves] == [action]
        assert draft.manifest.n_frames == truth.n_frames


def test_five_actions_take_about_half_a_minute(sample: Sample) -> None:
    assert 750 <= sample.truth.n_frames <= 1300
    seconds = (sample.draft.manifest.clock.duration_ns or 0) / 1e9
    assert (sample.truth.n_frames - 1) / seconds == pytest.approx(29.95, abs=0.06)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**63), st.lists(st.sampled_from(ACTIONS), min_size=1, max_size=4))
def test_any_actions_can_be_played_in_any_order(seed: int, actions: list[str]) -> None:
    _, truth = sample_session(seed=seed, actions=actions, noise=NOISELESS)
    assert [move.kind for move in truth.moves if move.kind != "set"] == actions
    assert truth.gap_m.min() > 0.0002
    assert (truth.position[..., 2] >= EDGE_M / 2).all()
    assert (np.abs(truth.position[..., 0]) < 0.6 - EDGE_M).all()
    assert (truth.position[..., 1] > TABLE_OUTLINE_M[:, 1].min() + EDGE_M / 2).all()
    assert (truth.position[..., 1] < TABLE_OUTLINE_M[:, 1].max() - EDGE_M / 2).all()
    for number, move in enumerate(truth.moves):
        assert move.kind == "set" or is_instance(move.kind, offsets(truth, number))


def test_a_thousand_frames_take_less_than_half_a_second() -> None:
    sample_session(seed=0)
    started = process_time()
    frames = sum(sample_session(seed=seed)[1].n_frames for seed in range(3))
    assert frames / (process_time() - started) > 2000


def test_a_box_that_is_not_moved_stands_exactly_still(sample: Sample) -> None:
    truth = sample.truth
    for box in (0, 1):
        still = ~truth.moving[box]
        both = still[1:] & still[:-1]
        assert (truth.position[box, 1:][both] == truth.position[box, :-1][both]).all()
        assert (truth.quaternion[box, 1:][both] == truth.quaternion[box, :-1][both]).all()
        assert (truth.position[box, still, 2] == EDGE_M / 2).all()
        assert (truth.quaternion[box, still, :2] == 0).all()


def test_one_box_moves_while_the_other_stands_and_only_in_a_hand(sample: Sample) -> None:
    truth = sample.truth
    assert truth.moving.any(1).all() or len({move.box for move in truth.moves}) == 1
    assert not truth.moving.all(0).any()
    assert (truth.holder[truth.moving] >= 0).all()
    assert (truth.holder >= 0).sum(0).max() == 1


def test_movements_are_smooth(sample: Sample) -> None:
    acceleration = np.diff(sample.truth.position, 2, axis=1)
    assert np.abs(acceleration).max() < 0.006  # metres per frame, per frame
    turn = np.abs(np.sum(sample.truth.quaternion[:, 1:] * sample.truth.quaternion[:, :-1], -1))
    assert turn.min() > np.cos(0.1 / 2)


def test_some_boxes_are_lifted_and_some_tilted(sample: Sample) -> None:
    truth = sample.truth
    assert truth.lift_m.max() > 0.03 or np.abs(truth.tilt_rad).max() > 0.15
    assert (truth.free <= truth.moving).all()


def test_the_hand_holds_its_box_rigidly(sample: Sample) -> None:
    truth = sample.truth
    for move in truth.moves:
        hand = truth.joints[:, JOINTS.index(move.hand)]
        for carry in move.carries:
            during = slice(carry.hold, carry.release)
            box = Rigid(truth.poses.rotation[move.box, during], truth.position[move.box, during])
            grip = box.inverse().apply(hand[during])
            assert np.abs(grip - grip[0]).max() < 1e-9
            assert np.abs(grip[0]).max() < EDGE_M / 2 + 0.05


def test_arms_keep_their_length_and_hands_do_not_jump(sample: Sample) -> None:
    truth = sample.truth
    for hand in HANDS:
        start, elbow, end = (
            truth.joints[:, JOINTS.index(name + hand.removeprefix("Hand"))]
            for name in ("Shoulder", "Elbow", "Hand")
        )
        for bone, length in ((elbow - start, UPPER_ARM_M), (end - elbow, FOREARM_M)):
            assert np.sqrt((bone**2).sum(-1)) == pytest.approx(length * truth.scene.scale, abs=1e-9)
        assert np.abs(np.diff(end, axis=0)).max() < 0.08
        assert np.abs(np.diff(elbow, axis=0)).max() < 0.12


# ---------------------------------------------------------------------------------------------- objects


def test_the_objects_are_a_rig_two_boxes_and_a_table(sample: Sample) -> None:
    kinds = [(thing.id, thing.kind, thing.name) for thing in sample.layer.objects]
    assert kinds == [
        ("o1", "rig", "Performer 1"),
        ("o2", "marker_box", "Shell"),
        ("o3", "marker_box", "Stella Artois"),
        ("o4", "polygon", "table"),
    ]


def test_the_table_is_drawn_in_the_image_and_in_space_near_where_it_is(sample: Sample) -> None:
    table = sample.layer.objects[3]
    plane = sample.truth.scene.depth_from_table.inverse()
    assert [key.frame for key in table.key_frames] == [0, sample.truth.n_frames // 2]
    for flat, deep in zip(table.key_frames, table.key_frames_3d, strict=True):
        drawn = np.array(flat.coordinates).reshape(-1, 2)
        assert ((drawn >= 0) & (drawn <= [1920, 1080])).all()
        assert drawn == pytest.approx(sample.truth.scene.pixels(TABLE_OUTLINE_M), abs=8)
        height = plane.apply(np.array(deep.coordinates).reshape(-1, 3))[:, 2]
        assert 1e-4 < np.abs(height).max() < 0.02


# ----------------------------------------------------------------------------------------------- events


def actions_of(sample: Sample) -> list[Event]:
    return [event for event in sample.layer.events if event.parent is None]


def parts_of(sample: Sample, action: Event) -> list[Event]:
    return [event for event in sample.layer.events if event.parent == action.id]


def test_each_action_is_told_once_with_text_roles_and_references(sample: Sample) -> None:
    names = {thing.id: thing.name for thing in sample.layer.objects}
    actions = actions_of(sample)
    assert [event.type for event in actions] == [f"slide_{kind}" for kind in ACTIONS]
    played = [move for move in sample.truth.moves if move.kind != "set"]
    for event, move in zip(actions, played, strict=True):
        roles = {role.name: role.target for role in event.roles}
        assert roles["Agent"] == "o1"
        assert roles["Theme"] == sample.truth.object_ids[move.box]
        assert roles["Landmark"] == sample.truth.object_ids[move.landmark]
        referred = {event.text[r.start : r.end]: r.target for r in event.references}
        assert referred == {
            names[roles["Theme"]]: roles["Theme"],
            names[roles["Landmark"]]: roles["Landmark"],
        }
        assert [event.text[p.start : p.end] for p in event.predicates] == ["Slide"]


def test_texts_read_like_those_of_the_real_sessions() -> None:
    draft, _ = sample_session(seed=2)
    texts = [
        e.text.replace("Shell", "A").replace("Stella Artois", "A") for e in draft.layers[0].events if e.text
    ]
    assert texts == [f"Slide A {how} A" for how in ("next to", "past", "around", "toward", "away from")]


def test_grasp_hold_and_release_tile_each_segment_and_the_movement_is_within_the_hold(sample: Sample) -> None:
    for action in actions_of(sample):
        parts = parts_of(sample, action)
        assert len(parts) == 4 * len(action.segments)
        for i, segment in enumerate(action.segments):
            grasp, hold, move, release = parts[4 * i : 4 * i + 4]
            assert [p.type for p in parts[4 * i : 4 * i + 4]] == ["grasp", "hold", "move", "release"]
            tiles = [grasp.segments[0], hold.segments[0], release.segments[0]]
            assert tiles[0].start_frame == segment.start_frame
            assert tiles[-1].end_frame == segment.end_frame
            assert all(a.end_frame == b.start_frame for a, b in pairwise(tiles))
            assert tiles[1].start_frame < move.segments[0].start_frame
            assert move.segments[0].end_frame < tiles[1].end_frame
            assert [link.target for link in hold.links] == [move.id]


def test_movement_events_are_when_the_theme_moves(sample: Sample) -> None:
    truth = sample.truth
    told = np.zeros(truth.moving.shape, bool)
    for event in sample.layer.events:
        if event.type == "move":
            theme = next(role.target for role in event.roles if role.name == "Theme")
            segment = event.segments[0]
            told[truth.object_ids.index(theme), segment.start_frame : segment.end_frame] = True
    rearranged = np.zeros(truth.moving.shape, bool)
    for move in truth.moves:
        for carry in move.carries if move.kind == "set" else ():
            rearranged[move.box, carry.move : carry.still] = True
    assert (told == (truth.moving & ~rearranged)).all()


def test_one_action_is_interrupted_and_has_two_segments(sample: Sample) -> None:
    segments = Counter(len(event.segments) for event in actions_of(sample))
    assert segments == {1: 4, 2: 1}
    (split,) = [event for event in actions_of(sample) if len(event.segments) == 2]
    first, second = split.segments
    assert first.end_frame < second.start_frame


def test_events_follow_one_another_inside_the_recording(sample: Sample) -> None:
    segments = [segment for event in actions_of(sample) for segment in event.segments]
    assert segments[0].start_frame > 0
    assert segments[-1].end_frame < sample.truth.n_frames
    assert all(a.end_frame < b.start_frame for a, b in pairwise(segments))


def test_ids_are_unique_and_counted(sample: Sample) -> None:
    layer = sample.layer
    assert [event.id for event in layer.events] == [f"a{i}" for i in range(1, layer.event_counter + 1)]
    assert [thing.id for thing in layer.objects] == [f"o{i}" for i in range(1, layer.object_counter + 1)]


def test_the_annotation_follows_its_scheme(sample: Sample) -> None:
    types = {event_type.name: event_type for event_type in SCHEME.event_types}
    tiers = {tier.name for tier in SCHEME.tiers}
    predicates = {predicate.name for predicate in SCHEME.predicates}
    assert sample.layer.scheme == SCHEME.name
    for event in sample.layer.events:
        assert event.tier in tiers
        assert event.tier == types[event.type].tier
        assert {(role.name, role.kind) for role in event.roles} == {
            (r.name, r.kind) for r in types[event.type].roles
        }
        assert {link.type for link in event.links} <= predicates
    assert {relation.predicate for relation in sample.layer.relations} <= predicates


def spans(sample: Sample) -> list[Segment | Relation]:
    return [s for event in sample.layer.events for s in event.segments] + [*sample.layer.relations]


def test_times_are_those_of_the_clock(sample: Sample) -> None:
    clock, n = sample.truth.clock, sample.truth.n_frames
    for span in spans(sample):
        assert span.end_frame is not None
        assert span.start_ns == clock.t_ns(span.start_frame, n)
        assert span.end_ns == clock.t_ns(span.end_frame, n)
    assert sample.truth.t_ns[-1] == clock.duration_ns


# -------------------------------------------------------------------------------------------- relations


def told(sample: Sample, predicate: str, *targets: str) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Frames in which the layer says that a relation holds."""
    holds = np.zeros(sample.truth.n_frames, bool)
    for relation in sample.layer.relations:
        if relation.predicate == predicate and relation.targets == targets and relation.polarity:
            holds[relation.start_frame : relation.end_frame] = True
    return holds


def test_a_box_is_on_the_table_unless_it_is_lifted(sample: Sample) -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * EDGE_M / 2
    for box, object_id in enumerate(sample.truth.object_ids):
        poses = sample.truth.poses
        lowest = (poses.rotation[box] @ corners.T).min(-1)[:, 2] + poses.translation[box, :, 2]
        assert (told(sample, "ON", object_id, "o4") == (lowest <= ON_M + 1e-12)).all()


@pytest.mark.parametrize(("predicate", "limit"), [("TOUCHING", TOUCHING_M), ("NEAR", NEAR_M)])
def test_boxes_touch_or_are_near_where_their_outlines_are(
    sample: Sample, predicate: str, limit: float
) -> None:
    truth = sample.truth
    holds = told(sample, predicate, "o2", "o3")
    s = np.linspace(-EDGE_M / 2, EDGE_M / 2, 77)
    half = np.full_like(s, EDGE_M / 2)
    foot = np.concatenate([np.stack(p, -1) for p in ((s, half), (s, -half), (half, s), (-half, s))])
    upright = ~truth.free.any(0)
    for frame in np.flatnonzero(upright)[::20]:
        a, b = (
            foot @ truth.poses.rotation[k, frame, :2, :2].T + truth.position[k, frame, :2] for k in (0, 1)
        )
        least = np.sqrt(((a[:, None] - b) ** 2).sum(-1)).min()
        if abs(least - limit) > 1e-3:
            assert holds[frame] == (least < limit)


def test_boxes_put_next_to_each_other_touch_afterwards(sample: Sample) -> None:
    move = next(move for move in sample.truth.moves if move.kind == "next")
    touching = told(sample, "TOUCHING", "o2", "o3")
    assert not touching[move.carries[0].reach]
    assert touching[move.carries[-1].still : move.carries[-1].end].all()


def test_one_relation_is_denied_and_rightly(sample: Sample) -> None:
    (denied,) = [relation for relation in sample.layer.relations if not relation.polarity]
    assert denied.source == "marked"
    assert (sample.truth.gap_m[denied.start_frame : denied.end_frame] > TOUCHING_M).all()
    assert not told(sample, denied.predicate, *denied.targets)[denied.start_frame : denied.end_frame].any()
