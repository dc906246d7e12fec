"""Skeletons of NTU RGB+D."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ecat.check import check
from ecat.errors import EcatError, FormatError, LimitError
from ecat.formats import import_source
from ecat.formats.recordings.ntu import parse
from ecat.store import open_session

# of the file with the bodies [0], [0, 1], [1]: the line, from zero, of the last joint of each
BODY_LINES = (28, 56, 83, 111)


def skeletons(frames: list[list[int]], seed: int = 0) -> tuple[str, NDArray[np.float64]]:
    """A file in which these bodies are seen in each frame, and its numbers (bodies, 25, 12)."""
    rng = np.random.default_rng(seed)
    lines = [str(len(frames))]
    values: list[NDArray[np.float64]] = []
    for bodies in frames:
        lines.append(str(len(bodies)))
        for body in bodies:
            joints = rng.normal(size=(25, 12)).round(6)
            joints[:, 11] = rng.integers(0, 3, 25)
            lines += [f"{72057594037944738 + body} 0 1 1 1 1 0 0.02 -0.2 2", "25"]
            lines += [" ".join(f"{v:.7g}" for v in joint) for joint in joints]
            values.append(joints)
    return "\n".join(lines) + "\n", np.array(values).reshape(-1, 25, 12)


def test_joints_are_read_in_the_axes_of_the_camera(tmp_path: Path) -> None:
    text, values = skeletons([[0], [0, 1], [], [1]])
    (tmp_path / "S001C001.skeleton").write_text(text)
    report = import_source(tmp_path / "S001C001.skeleton", tmp_path / "s")
    session = open_session(report.path)
    assert report.findings == ()
    assert session.manifest.n_frames == 4
    rows = session.table("joints").to_arrow()
    assert rows.num_rows == 4 * 25
    got = np.column_stack([rows[name].to_numpy() for name in ("x", "y", "z", "u_px", "v_px")]).reshape(
        -1, 25, 5
    )
    expected = values[..., [0, 1, 2, 5, 6]] * [-1, -1, 1, 1, 1]
    np.testing.assert_allclose(got, expected, rtol=1e-6)
    assert rows["frame"].to_pylist()[::25] == [0, 1, 1, 3]
    assert rows["body"].to_pylist()[::25] == [0, 0, 1, 1]
    states = ["not_tracked", "inferred", "tracked"]
    assert rows["state"].to_pylist() == [states[int(v)] for v in values[..., 11].ravel()]
    assert rows["joint"].to_pylist()[:4] == ["SpineBase", "SpineMid", "Neck", "Head"]
    assert [f for f in check(report.path) if f.severity == "error"] == []


@given(st.integers(1, 20_000))
def test_a_file_that_ends_early_keeps_the_bodies_that_are_whole(keep: int) -> None:
    frames = [[0], [0, 1], [1]]
    text, values = skeletons(frames)
    # where each body's last line ends, without its line break
    ends = [i for i in range(len(text)) if text[:i].count("\n") in BODY_LINES and text[i] == "\n"]
    whole = sum(end <= keep for end in ends)
    found = parse(text[:keep].encode())
    assert len(found.frame) == whole
    np.testing.assert_allclose(found.values[..., 2], values[:whole, :, 2], rtol=1e-6)
    assert bool(found.notes) == (keep < ends[-1])


@pytest.mark.parametrize(
    ("data", "where"),
    [
        (b"", "empty"),
        (b"many\n", "number of frames"),
        (b"-1\n", "number of frames"),
        (b"1\n999999999\n", "number of bodies"),
        (b"1\n1\n7 0 0\n24\n", "25 joints"),
        (b"1\n1\n7 0 0\n25\n" + b"1 2 3\n" * 25, "12 numbers"),
        (b"1\n1\n7 0 0\n25\n" + b"a b c d e f g h i j k l\n" * 25, "12 numbers"),
        (b"1\n1\n" + b"7" * 10_000 + b"\n25\n", "4096 bytes"),
    ],
)
def test_what_is_not_the_format_is_an_error_that_names_the_line(data: bytes, where: str) -> None:
    with pytest.raises(FormatError, match="cannot read") as caught:
        parse(data)
    assert where in caught.value.where


def test_more_bodies_than_can_be_told_apart_are_refused() -> None:
    text, _ = skeletons([list(range(100)), list(range(100, 200))])
    with pytest.raises(LimitError, match="cannot read"):
        parse(text.encode())


def test_numbers_that_are_none_are_unknown() -> None:
    joint = b"nan inf 1 2 3 -inf 5 6 7 8 9 7\n"
    found = parse(b"1\n1\n7 0\n25\n" + joint * 25)
    assert np.isnan(found.values[0, 0]).tolist() == [True, True, False, True, False, False]


@given(st.binary(max_size=300))
def test_any_bytes_give_skeletons_or_one_typed_error(data: bytes) -> None:
    try:
        found = parse(b"2\n1\n" + data)
    except EcatError:
        return
    assert len(found.frame) == len(found.body) == len(found.values)
