"""What holds of the relations by their definition, of whatever points and boxes."""

from __future__ import annotations

import math
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from learn.features import qsr
from learn.features.qsr import RELATIONS, codes, continuity

Floats = NDArray[np.float64]
CHAINED = pytest.mark.parametrize(
    "values", [qsr.QTC_B, qsr.QTC_C, qsr.QTC_BC], ids=["qtcbs", "qtccs", "qtcbcs"]
)
FACTORS = pytest.mark.parametrize("threshold", [0.0, 0.5, 2.0])
EVERY = pytest.mark.parametrize("name", RELATIONS)


def numbers(*, whole: bool = False, unknown: bool = False) -> st.SearchStrategy[float]:
    small = st.integers(-4, 4).map(float)
    real = st.floats(-10, 10, allow_subnormal=False).map(lambda value: round(value, 3))
    known = small if whole else st.one_of(small, real)
    return st.one_of(known, st.just(math.nan)) if unknown else known


def tracks(coordinates: int = 2, *, frames: int = 6, **kind: bool) -> st.SearchStrategy[Floats]:
    return arrays(np.float64, (frames, coordinates), elements=numbers(**kind))


def boxes() -> st.SearchStrategy[Floats]:
    """Boxes with edges at halves of whole numbers, so that they touch often; some without size."""
    sizes = arrays(np.float64, (6, 2), elements=st.integers(0, 4).map(float))
    return st.tuples(tracks(whole=True), sizes).map(np.hstack)


def parameters_of(name: str) -> dict[str, Any]:
    parameters: dict[str, dict[str, Any]] = {
        "argd": {"thresholds": {"near": 1.0, "far": 4.0, "out": 9.0}},
        "argprobd": {"bands": {"near": (1, 1.0), "far": (4, 2.0)}, "generator": qsr.seeded(7)},
        "mos": {"threshold": 1.0},
        "qtccs": {"threshold": 0.5, "angle": 0.3},
        "qtcbcs": {"threshold": 0.5, "distance": 4.0},
    }
    return parameters.get(name, {})


def objects_of(name: str, seed: int = 3, shape: tuple[int, ...] = (40,)) -> list[Floats]:
    """Random walks on a grid, of boxes where sizes count."""
    generator = np.random.default_rng(seed)
    relation = RELATIONS[name]
    walks = [
        np.cumsum(generator.integers(-1, 2, (*shape, 2)), axis=-2) / 2.0 for _ in range(relation.objects)
    ]
    if relation.of_boxes:
        walks = [np.concatenate([each, generator.integers(0, 5, each.shape) / 1.0], -1) for each in walks]
    return walks


# --- shapes


@EVERY
def test_any_number_of_pairs_in_one_call_is_the_same_as_one_after_the_other(name: str) -> None:
    relation, objects = RELATIONS[name], objects_of(name, shape=(3, 2, 20))
    together = relation.compute(*objects, **parameters_of(name))
    assert together.dtype == np.uint8
    assert together.shape == (3, 2, 20 if relation.frames == 1 else 19)
    same = parameters_of(name)  # with one generator, in the order of the array
    for place in product(range(3), range(2)):
        alone = relation.compute(*(each[place] for each in objects), **same)
        assert np.array_equal(together[place], alone)


@EVERY
def test_long_tracks_are_done_in_pieces_that_do_not_show(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = objects_of(name, shape=(100,))
    whole = RELATIONS[name].compute(*objects, **parameters_of(name))
    monkeypatch.setattr(codes, "CHUNK", 7)
    assert np.array_equal(RELATIONS[name].compute(*objects, **parameters_of(name)), whole)


@EVERY
def test_what_is_not_known_is_missing_and_nothing_else_is(name: str) -> None:
    relation, objects = RELATIONS[name], objects_of(name)
    sure = relation.compute(*objects, **parameters_of(name))
    for unknown in (math.nan, math.inf):
        broken = [each.copy() for each in objects]
        broken[-1][10, 0] = unknown
        found = relation.compute(*broken, **parameters_of(name))
        gone = [10] if relation.frames == 1 else [9, 10]
        assert (found[gone] == qsr.MISSING).all()
        rest = np.delete(np.arange(len(found)), gone)
        assert (found[rest] != qsr.MISSING).all()
        assert np.array_equal(found[rest], sure[rest])
        assert qsr.to_arrow(found, relation.values_of(parameters_of(name))).null_count == len(gone)


@EVERY
def test_no_frames_have_no_values(name: str) -> None:
    relation = RELATIONS[name]
    empty = [np.zeros((0, 2))] * relation.objects
    assert relation.compute(*empty, **parameters_of(name)).shape == (0,)
    single = [np.zeros((1, 2))] * relation.objects
    assert relation.compute(*single, **parameters_of(name)).shape == (2 - relation.frames,)


@pytest.mark.parametrize("shape", [(), (4,), (3, 1), (3, 5)])
def test_arrays_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    wrong = np.zeros(shape)
    if shape == (4,):
        wrong = np.zeros((4, 2))
    with pytest.raises(UsageError, match="cannot compute a relation"):
        qsr.cardir(wrong, np.zeros((3, 2)))


def test_a_single_position_is_no_movement() -> None:
    with pytest.raises(UsageError, match="of movement"):
        qsr.mos([1.0, 2.0])


@pytest.mark.parametrize("threshold", [-1.0, math.nan, math.inf])
def test_a_threshold_is_a_length(threshold: float) -> None:
    for compute, objects in ((qsr.mos, 1), (qsr.qtc_c, 2), (qsr.rcc8, 2)):
        with pytest.raises(UsageError, match="threshold"):
            compute(*[np.zeros((3, 2))] * objects, threshold=threshold)


@pytest.mark.parametrize("angle", [-0.1, 3.2, math.nan])
def test_an_angle_is_at_most_half_a_turn(angle: float) -> None:
    with pytest.raises(UsageError, match="angle"):
        qsr.qtc_c(np.zeros((3, 2)), np.zeros((3, 2)), angle=angle)


@pytest.mark.parametrize("thresholds", [{}, {"a": math.nan}, {str(k): k / 1.0 for k in range(256)}])
def test_distances_need_a_threshold_and_not_too_many(thresholds: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="thresholds"):
        qsr.argd(np.zeros((3, 2)), np.zeros((3, 2)), thresholds)


def test_a_negative_size_is_refused() -> None:
    with pytest.raises(InputError, match="boxes"):
        qsr.rcc8([[0.0, 0.0, -1.0, 1.0]], [[0.0, 0.0, 1.0, 1.0]])


# --- directions and distances


@given(a=tracks(unknown=True), b=tracks(unknown=True))
def test_cardinal_directions_are_opposite_from_the_other_side(a: Floats, b: Floats) -> None:
    one, other = qsr.cardir(a, b), qsr.cardir(b, a)
    turned = np.array([4, 5, 6, 7, 0, 1, 2, 3, 8, *[qsr.MISSING] * 247], np.uint8)
    assert np.array_equal(turned[one], other)


@given(st.integers(-180, 179), st.floats(0.1, 100))
def test_a_sector_is_45_degrees_wide_around_its_compass_point(degrees: int, distance: float) -> None:
    clockwise = math.radians(degrees + 0.25)
    place = distance * np.array([[math.sin(clockwise), math.cos(clockwise)]])
    names = ["n", "ne", "e", "se", "s", "sw", "w", "nw"]
    expected = names[round((degrees + 0.25) / 45) % 8]
    assert qsr.to_names(qsr.cardir(place, np.zeros((1, 2))), qsr.CARDIR) == [expected]


@given(tracks(unknown=True), tracks(unknown=True))
def test_left_of_is_the_converse_of_right_of(a: Floats, b: Floats) -> None:
    one, other = qsr.mwe(a, b), qsr.mwe(b, a)
    assert np.array_equal(np.where(one == qsr.MISSING, one, 2 - one), other)


@given(
    a=tracks(whole=True), b=tracks(whole=True), limits=st.lists(st.integers(0, 8), min_size=1, max_size=70)
)
def test_a_distance_gets_the_first_threshold_that_it_does_not_exceed(
    a: Floats, b: Floats, limits: list[int]
) -> None:
    found = qsr.argd(a, b, limits)
    ordered = sorted(limits)
    for code, distance in zip(found, np.hypot(*(a - b).T), strict=True):
        assert ordered[code] == next((limit for limit in ordered if distance <= limit), ordered[-1])


def test_height_counts_where_both_have_one() -> None:
    a, b = [[0.0, 0.0, 0.0], [0.0, 0.0, math.nan]], [[0.0, 0.0, 5.0], [0.0, 0.0, 5.0]]
    limits = {"near": 1.0, "far": 9.0}
    assert qsr.to_names(qsr.argd(a, b, limits), qsr.argd_values(limits)) == ["far", "near"]


def test_draws_are_those_of_python() -> None:
    import random

    python = random.Random(123456789012345678901234567890)
    assert qsr.seeded(123456789012345678901234567890).random(700).tolist() == [
        python.random() for _ in range(700)
    ]


# --- trajectories


@given(a=tracks(unknown=True), b=tracks(unknown=True), threshold=st.sampled_from([0.0, 0.01, 1.0]))
def test_the_mirrored_pair_has_the_symbols_exchanged(a: Floats, b: Floats, threshold: float) -> None:
    one = qsr.to_names(qsr.qtc_c(a, b, threshold=threshold, angle=0.2), qsr.QTC_C)
    other = qsr.to_names(qsr.qtc_c(b, a, threshold=threshold, angle=0.2), qsr.QTC_C)
    swapped = [None if name is None else ",".join(name.split(",")[k] for k in (1, 0, 3, 2)) for name in one]
    assert swapped == other


@given(a=tracks(whole=True), b=tracks(whole=True))
def test_in_a_mirror_left_and_right_are_exchanged(a: Floats, b: Floats) -> None:
    flip = str.maketrans("-+", "+-")
    seen = qsr.to_names(qsr.qtc_c(a, b), qsr.QTC_C)
    mirrored = qsr.to_names(qsr.qtc_c(a * [-1, 1], b * [-1, 1]), qsr.QTC_C)
    assert mirrored == [name and name[:4] + name[4:].translate(flip) for name in seen]


@given(a=tracks(), b=tracks(), threshold=st.sampled_from([0.0, 0.3]))
def test_the_basic_calculus_is_half_of_the_double_cross(a: Floats, b: Floats, threshold: float) -> None:
    both = qsr.qtc_c(a, b, threshold=threshold)
    basic = qsr.qtc_b(a, b, threshold=threshold)
    assert np.array_equal(both // 9, basic)
    mixed = qsr.qtc_bc(a, b, threshold=threshold, distance=3.0)
    far = np.hypot(*(a - b)[1:].T) > 3.0
    assert np.array_equal(mixed, np.where(far, 81 + basic, both))


def test_the_side_counts_beyond_the_angle() -> None:
    ahead = [[[0, 0], [math.cos(turn), math.sin(turn)]] for turn in (0.1, 0.5, 2.0, 3.1)]
    target = [[[9.0, 0.0], [9.0, 0.0]]] * 4
    sides = [str(name).split(",")[2] for name in qsr.to_names(qsr.qtc_c(ahead, target, angle=0.3), qsr.QTC_C)]
    assert sides == ["0", "-", "-", "-"]


# --- chains


@CHAINED
@given(data=st.data())
def test_collapsing_again_changes_nothing(values: tuple[str, ...], data: st.DataObject) -> None:
    states = data.draw(arrays(np.uint8, 30, elements=st.integers(0, 4)))
    once = qsr.chain(states, values, collapse=True, validate=False)
    assert (once[1:] != once[:-1]).all()
    assert np.array_equal(qsr.chain(once, values, collapse=True, validate=False), once)


@CHAINED
def test_no_symbol_jumps_over_zero_in_a_valid_chain(values: tuple[str, ...]) -> None:
    table = continuity.between(values)
    for before, after in product(range(len(values)), repeat=2):
        passed = table[before, after]
        way = [before, after] if passed == qsr.MISSING else [before, int(passed), after]
        for one, other in pairwise(way):
            for left, right in zip(values[one].split(","), values[other].split(","), strict=False):
                assert {left, right} != {"-", "+"}


@CHAINED
@given(data=st.data())
def test_many_tracks_make_the_chains_of_each(values: tuple[str, ...], data: st.DataObject) -> None:
    code = st.one_of(st.integers(0, len(values) - 1), st.just(qsr.MISSING))
    states = data.draw(arrays(np.uint8, 40, elements=code))
    tracks = np.sort(data.draw(arrays(np.int32, 40, elements=st.integers(0, 4))))
    flags = {"collapse": data.draw(st.booleans()), "validate": data.draw(st.booleans())}
    found, of = qsr.chains(states, tracks, values, **flags)
    for track in range(5):
        alone = qsr.chain(states[tracks == track], values, **flags)
        assert np.array_equal(found[of == track], alone)
        assert np.array_equal(qsr.positions(of)[of == track], np.arange(len(alone)) + 1)


# --- boxes


@FACTORS
@given(a=boxes(), b=boxes())
def test_the_converse_of_regions(threshold: float, a: Floats, b: Floats) -> None:
    converse = {"tpp": "tppi", "ntpp": "ntppi", "tppi": "tpp", "ntppi": "ntpp"}
    one = qsr.to_names(qsr.rcc8(a, b, threshold=threshold), qsr.RCC8)
    other = qsr.to_names(qsr.rcc8(b, a, threshold=threshold), qsr.RCC8)
    assert [converse.get(str(name), name) for name in one] == other


@given(a=boxes(), b=boxes())
def test_coarser_calculi_join_relations_of_the_finest(a: Floats, b: Floats) -> None:
    finest = qsr.rcc8(a, b)
    for coarse, values in (
        (qsr.rcc2, qsr.RCC2),
        (qsr.rcc3, qsr.RCC3),
        (qsr.rcc4, qsr.RCC4),
        (qsr.rcc5, qsr.RCC5),
    ):
        names = qsr.to_names(coarse(a, b), values)
        assert len(set(zip(finest.tolist(), names, strict=True))) == len(set(finest.tolist()))


@given(a=boxes(), b=boxes())
def test_the_converse_of_intervals_is_the_same_place_from_the_end(a: Floats, b: Floats) -> None:
    one, other = qsr.ra(a, b), qsr.ra(b, a)
    points = ((a[:, 2:] == 0) & (b[:, 2:] == 0)).any(axis=1)  # equal points meet, both ways
    assert np.array_equal((168 - one)[~points], other[~points])


@given(a=boxes(), b=boxes())
def test_rectangle_algebra_and_regions_agree(a: Floats, b: Floats) -> None:
    sized = (a[:, 2:] > 0).all(axis=1) & (b[:, 2:] > 0).all(axis=1)
    for region, name in zip(qsr.rcc8(a, b)[sized], qsr.to_names(qsr.ra(a, b)[sized], qsr.RA), strict=True):
        x, y = str(name).split(",")
        within = {"s", "d", "f", "="}
        expected = (
            "dc"
            if {x, y} & {"<", ">"}
            else "ec"
            if {x, y} & {"m", "mi"}
            else "eq"
            if x == y == "="
            else "ntpp"
            if x == y == "d"
            else "ntppi"
            if x == y == "di"
            else "tpp"
            if {x, y} <= within
            else "tppi"
            if {x, y} <= {"si", "di", "fi", "="}
            else "po"
        )
        assert qsr.RCC8[region] == expected


# --- while it happens


@EVERY
def test_a_frame_at_a_time_gives_what_the_whole_track_gives(name: str) -> None:
    relation, objects = RELATIONS[name], objects_of(name, shape=(25, 6))  # frames first: six pairs at a time
    live = qsr.Live(relation, **parameters_of(name))
    said = np.array([live.feed(*frame) for frame in zip(*objects, strict=True)])
    if relation.frames == 2:
        assert (said[0] == qsr.MISSING).all()
        whole = relation.compute(*(each.swapaxes(0, 1) for each in objects), **parameters_of(name)).T
        assert np.array_equal(said[1:], whole)
    else:
        assert np.array_equal(said, relation.compute(*objects, **parameters_of(name)))


@CHAINED
@given(data=st.data())
def test_a_state_at_a_time_makes_the_same_chain(values: tuple[str, ...], data: st.DataObject) -> None:
    code = st.one_of(st.integers(0, len(values) - 1), st.just(qsr.MISSING))
    states = data.draw(arrays(np.uint8, 30, elements=code))
    flags = {"collapse": data.draw(st.booleans()), "validate": data.draw(st.booleans())}
    live = qsr.LiveChain(values, **flags)
    said = [state for each in states.tolist() for state in live.feed(each)]
    assert said == qsr.chain(states, values, **flags).tolist() if any(flags.values()) else True
