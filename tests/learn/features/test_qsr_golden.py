"""Every relation equals QSRLib on what QSRLib said about its own test worlds, random tracks, and hand-made cases."""

from __future__ import annotations

import csv
import json
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from learn.features import qsr
from learn.features.qsr import RELATIONS

Rows = dict[tuple[float, str], str | None]
TWO_FLAGS = [(True, False), (True, True), (False, True), (False, False)]


@pytest.fixture(scope="module")
def golden_data(shared: Path) -> Path:
    folder = shared / "qsr_golden"
    if not folder.is_dir():
        pytest.skip("qsr_golden is not in the reference data")
    return folder


@cache
def world(path: Path) -> dict[str, NDArray[np.float64]]:
    """Objects of a world, (frames, 4)."""
    rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))
    return {
        f"o{k}": np.array(
            [[float(row.get(f"{column}{k}") or "nan") for column in "xywl"] for row in rows], np.float64
        )
        for k in (1, 2, 3)
        if f"x{k}" in rows[0]
    }


def parameters_of(name: str, given: dict[str, Any]) -> dict[str, Any]:
    """QSRLib's arguments as ours."""
    mine = {**given.get("for_all_qsrs", {}), **given.get(name, {})}
    names = {
        "quantisation_factor": "threshold",
        "distance_threshold": "distance",
        "qsr_relations_and_values": "bands" if name == "argprobd" else "thresholds",
    }
    found = {names[key]: value for key, value in mine.items() if key in names}
    if name.startswith("qtc"):
        found |= {"collapse": not mine.get("no_collapse", False), "validate": mine.get("validate", True)}
    return found


def computed(name: str, objects: dict[str, NDArray[np.float64]], given: dict[str, Any]) -> Rows:
    """What we say, by QSRLib's time and object names; ``t`` counts from 1."""
    relation, parameters = RELATIONS[name], parameters_of(name, given)
    flags = [parameters.pop(flag, False) for flag in ("collapse", "validate")]
    wanted = {**given.get("for_all_qsrs", {}), **given.get(name, {})}.get("qsrs_for")
    if wanted is None:
        wanted = permutations(reversed(list(objects)), relation.objects)
    wanted = [(each,) if isinstance(each, str) else tuple(each) for each in wanted]
    if name == "argprobd":  # QSRLib draws frame by frame, for one pair after the other
        parameters["generator"] = qsr.seeded(100)
        first, second = (np.stack([objects[pair[side]] for pair in wanted], axis=1) for side in (0, 1))
        codes = relation.compute(first, second, **parameters).T
    else:
        codes = [relation.compute(*(objects[each] for each in pair), **parameters) for pair in wanted]
    found: Rows = {}
    for pair, raw in zip(wanted, codes, strict=True):
        states, times = raw, np.arange(len(raw)) + relation.frames
        if any(flags):
            states = qsr.chain(raw, relation.values_of(parameters), collapse=flags[0], validate=flags[1])
            times = np.arange(len(states)) + 1
        names = qsr.to_names(states, relation.values_of(parameters))
        found |= {(float(t), ",".join(pair)): value for t, value in zip(times, names, strict=True)}
    return found


def expected(path: Path) -> dict[str, Rows]:
    rows: dict[str, Rows] = defaultdict(dict)
    if path.suffix == ".csv":
        listed: Any = csv.DictReader(path.read_text("utf-8").splitlines())
    else:
        listed = pq.read_table(path).to_pylist()
    for row in listed:
        rows[row["case"]][float(row["t"]), row["objects"]] = row["value"]
    return rows


@pytest.mark.parametrize("file", ["data1_expected.csv", "first300_expected.parquet"])
def test_equals_qsrlib_on_its_own_worlds(golden_data: Path, file: str) -> None:
    cases = json.loads((golden_data / "cases.json").read_text("utf-8"))
    compared = 0
    for case, rows in expected(golden_data / file).items():
        about = cases[case]
        path = golden_data / f"{about['world']}.csv"
        if path.is_file():
            assert computed(about["qsr"], world(path), about["dynamic_args"]) == rows, case
            compared += len(rows)
    assert compared > 4000


def random_tracks(golden_data: Path) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    columns = pq.read_table(golden_data / "random_tracks.parquet").to_pydict()
    track = np.array(columns["track"])
    a, b = (np.array([columns[f"x{k}"], columns[f"y{k}"]]).T for k in (1, 2))
    return {int(each): (a[track == each], b[track == each]) for each in np.unique(track)}


def test_equals_qsrlib_frame_by_frame_on_random_tracks(golden_data: Path) -> None:
    parameters = json.loads((golden_data / "random_params.json").read_text("utf-8"))
    said = pq.read_table(golden_data / "random_expected_frame.parquet").to_pandas()
    tracks = random_tracks(golden_data)
    for number, rows in said.groupby("track"):
        a, b = tracks[int(number)]  # pyright: ignore[reportArgumentType]
        found = {
            "cardir_12": qsr.to_names(qsr.cardir(a, b), qsr.CARDIR),
            "cardir_21": qsr.to_names(qsr.cardir(b, a), qsr.CARDIR),
        }
        for name, limits in parameters["argd"].items():
            found[f"argd_{name}"] = qsr.to_names(qsr.argd(a, b, limits), qsr.argd_values(limits))
        for threshold in parameters["mos_q"]:
            for side, each in (("o1", a), ("o2", b)):
                names = qsr.to_names(qsr.mos(each, threshold=threshold), qsr.MOS)
                found[f"mos_{side}_q{threshold:g}"] = [None, *names]
        for column, values in found.items():
            given = [value if isinstance(value, str) else None for value in rows[column]]
            assert given == values, (number, column)


def test_equals_qsrlib_on_the_trajectories_of_random_tracks(golden_data: Path) -> None:
    parameters = json.loads((golden_data / "random_params.json").read_text("utf-8"))
    said = pq.read_table(golden_data / "random_expected_qtc.parquet").to_pandas()
    tracks = random_tracks(golden_data)
    for number, rows in said.groupby("track"):
        a, b = tracks[int(number)]  # pyright: ignore[reportArgumentType]
        found = {f"q{q:g}": (qsr.qtc_c(a, b, threshold=q), f"q{q:g}") for q in parameters["qtc_q"]}
        for each in parameters["angle_sets"]:
            q, angle = each["quantisation_factor"], each["angle_quantisation_factor"]
            found[each["column"]] = qsr.qtc_c(a, b, threshold=q, angle=angle), f"q{q:g}"
        compared = {column: (qsr.to_names(codes, qsr.QTC_C), q) for column, (codes, q) in found.items()}
        limit = parameters["qtcbcs_distance_threshold"]
        compared["qtcbs_q0.001"] = qsr.to_names(qsr.qtc_b(a, b, threshold=0.001), qsr.QTC_B), "q0.001"
        near = qsr.qtc_bc(a, b, threshold=0.001, distance=limit)
        compared["qtcbcs_q0.001"] = qsr.to_names(near, qsr.QTC_BC), "q0.001"
        for column, (names, q) in compared.items():
            sure = ~rows[f"{q}_ambiguous"].to_numpy(bool)
            assert (rows[column].to_numpy(object) == np.array(names, object))[sure].all(), (number, column)


def test_equals_qsrlib_on_chains_of_random_tracks(golden_data: Path) -> None:
    tracks, compared = random_tracks(golden_data), 0
    for row in pq.read_table(golden_data / "random_expected_qtc_chains.parquet").to_pylist():
        relation = RELATIONS[row["qsr"]]
        codes = relation.compute(*tracks[row["track"]], threshold=row["q"])
        states = qsr.chain(codes, relation.values, collapse=not row["no_collapse"], validate=row["validate"])
        if not row["any_ambiguous"]:
            assert ";".join(map(str, qsr.to_names(states, relation.values))) == row["chain"], row
            compared += 1
    assert compared > 1000


@pytest.mark.parametrize("name", ["qtcbs", "qtccs", "qtcbcs"])
@pytest.mark.parametrize(("no_collapse", "validate"), TWO_FLAGS)
def test_equals_qsrlib_on_a_human_and_a_robot(
    golden_data: Path, name: str, no_collapse: bool, validate: bool
) -> None:
    rows = list(csv.DictReader((golden_data / "qtc.csv").read_text("utf-8").splitlines()))
    human, robot = (np.array([[float(row[f"x{k}"]), float(row[f"y{k}"])] for row in rows]) for k in (1, 2))
    said = json.loads((golden_data / "qtc_expected.json").read_text("utf-8"))["expected"][name]
    relation = RELATIONS[name]
    parameters = {"threshold": 0.01} | ({"distance": 1.2} if name == "qtcbcs" else {})
    codes = relation.compute(human, robot, **parameters)
    states = qsr.chain(codes, relation.values, collapse=not no_collapse, validate=validate)
    assert qsr.to_names(states, relation.values) == said[f"nc{no_collapse:d}_v{validate:d}"]


def edge_cases(golden_data: Path) -> Iterator[dict[str, Any]]:
    for line in (golden_data / "edge_cases.jsonl").read_text("utf-8").splitlines():
        case = json.loads(line)
        for name in [case["qsr"]] if isinstance(case["qsr"], str) else case["qsr"]:
            yield {**case, "qsr": name}


DEFINED_OTHERWISE = {
    "cardir_none": ["se"],
    "tpcc_2pi_rounding": ["csb"],
    "mos_gap_in_track": [None, None, "m", "s"],
    "qtccs_missing_object": [None, None],
    "qtcbs_missing_object_tolerated": [None, None, "-,-"],
    "qtccs_nan": [None],
    "qtccs_one_timestamp": [],
}
"""Where QSRLib crashes, says None or tells the wrong time; or leaves out what we call missing."""
NOT_ABOUT_RELATIONS = {
    "argd_missing_params",
    "argd_wrong_value_type",
    "qtccs_unknown_param",
    "qtccs_nonbool_validate",
    "qsrs_for_unknown_object",
}


def state(case: dict[str, Any], name: str, t: float) -> list[float]:
    for row in case["tracks"][name]:
        values = [row.get(c, "nan") for c in ("timestamp", "x", "y", "z")] if isinstance(row, dict) else row
        if values[0] == t:
            given = [float(value) for value in values[1:]]
            return given if isinstance(row, dict) else given + [np.nan] * (4 - len(given))
    return [np.nan] * 4


def test_equals_qsrlib_on_hand_made_cases(golden_data: Path) -> None:
    compared = 0
    for case in edge_cases(golden_data):
        if case["name"] in NOT_ABOUT_RELATIONS:
            continue
        name, given = case["qsr"], case["dynamic_args"]
        times = sorted(
            {
                t
                for rows in case["tracks"].values()
                for t in (row["timestamp"] if isinstance(row, dict) else row[0] for row in rows)
            }
        )
        objects = {each: np.array([state(case, each, t) for t in times]) for each in case["tracks"]}
        wanted = given.get(name, {}).get("qsrs_for") or list(
            permutations(sorted(objects), RELATIONS[name].objects)
        )
        pairs = [",".join([each] if isinstance(each, str) else each) for each in wanted]
        found = computed(name, objects, {name: {**given.get(name, {}), "qsrs_for": wanted}})
        values = [value for pair in pairs for (_, who), value in found.items() if who == pair]
        if case["name"] in DEFINED_OTHERWISE:
            assert values == DEFINED_OTHERWISE[case["name"]], case["name"]
        else:
            said = [(who, value[name]) for _, who, value in case["result"] if name in value]
            assert values == [value for pair in pairs for who, value in said if who == pair], case["name"]
        compared += 1
    assert compared > 100
