"""Golden files: what import, generation, stages and `ecat info` give for the shipped samples, as readable text.

Numbers are rounded, so that another processor's last digit is no difference.  `make golden` accepts new output; its
diff is the review.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from ecat.checkout import checkout_folder
from ecat.cli import main
from ecat.formats import export, import_source
from ecat.geometry.transforms import Floats, Rigid
from ecat.process import process_session, read_prototypes
from ecat.sample.shipped import AS_ECAT_PROJECT, SESSIONS, WITH_PIXELS, write_shipped
from ecat.store import Session, find_sessions, open_session
from ecat.store.xml import layer_to_xml

if TYPE_CHECKING:
    from tests.conftest import Golden

FOLDER = checkout_folder("sample_sessions")
NUMBER = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
HEAD = 4
"""Rows that are shown of the start and of the end of a table."""


def rounded(text: str, digits: int) -> str:
    """The text with every decimal number rounded."""
    return NUMBER.sub(lambda found: f"{float(found.group()):.{digits}f}".rstrip("0").rstrip("."), text)


def table_text(table: pa.Table, digits: int = 4) -> str:
    """A table's shape; each column's type, number of nulls and range or number of values; its first and last rows."""
    lines = [f"{table.num_rows} rows"]
    lines += [
        f"{f.name}: {f.type}, {table[f.name].null_count} null{spread(table[f.name], digits)}"
        for f in table.schema
    ]
    rows = table.slice(0, HEAD).to_pylist() + table.slice(max(HEAD, table.num_rows - HEAD)).to_pylist()
    lines += [" | ".join(cell(value, digits) for value in row.values()) for row in rows]
    return "\n".join(lines) + "\n"


def spread(column: pa.ChunkedArray[Any], digits: int) -> str:
    """The least, middle and greatest number of a column, or how many different values it has."""
    values = [value for value in column.to_pylist() if value is not None]
    if not values or isinstance(values[0], list | bool):
        return ""
    if isinstance(values[0], str):
        return f", {len(set(values))} different"
    return "".join(
        f", {cell(of, digits)}" for of in (min(values), sorted(values)[len(values) // 2], max(values))
    )


def cell(value: object, digits: int) -> str:
    """One value of a table."""
    if isinstance(value, float):
        text = f"{value:.{digits}f}"
        return "0" if float(text) == 0 else text
    if isinstance(value, list):  # the last digits of a matrix are not the same on every processor
        return f"[{', '.join(f'{one:.6g}' if isinstance(one, float) else str(one) for one in value)}]"
    return "-" if value is None else str(value)


def check_session(
    golden: Golden, folder: str, session: Session, capsys: pytest.CaptureFixture[str], digits: int = 4
) -> None:
    """Compare a session's layer, tables and `ecat info`."""
    golden.check(f"{folder}/main.xml", rounded(layer_to_xml(session.layer()).decode(), 3))
    for record in session.manifest.tables:
        table = session.table(record.name).to_arrow()
        golden.check(f"{folder}/{record.name}.txt", table_text(table, digits))
    capsys.readouterr()
    assert main(["info", str(session.path)]) == 0
    golden.check(f"{folder}/info.txt", capsys.readouterr().out)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample sessions, made now."""
    dest = tmp_path_factory.mktemp("made")
    write_shipped(dest)
    return dest


@pytest.fixture(scope="module", autouse=True)
def rewritten(golden: Golden) -> None:
    """`make golden` also writes the shipped samples anew."""
    if golden.update:
        from ecat.sample.shipped import main as write_anew

        write_anew()


@pytest.mark.parametrize("name", SESSIONS)
def test_a_generated_session_is_as_ever(
    name: str, made: Path, golden: Golden, capsys: pytest.CaptureFixture[str]
) -> None:
    check_session(golden, f"generated/{name}", open_session(made / "sessions" / name), capsys)


@pytest.mark.parametrize("name", SESSIONS)
def test_the_shipped_session_is_the_generated_one(name: str, made: Path) -> None:
    shipped, now = (open_session(root / "sessions" / name) for root in (FOLDER, made))
    assert layer_to_xml(shipped.layer()) == layer_to_xml(now.layer())
    for record in now.manifest.tables:
        before, after = (table_text(s.table(record.name).to_arrow()) for s in (shipped, now))
        assert before == after, record.name


def test_the_shipped_ecat_project_imports_as_ever(
    tmp_path: Path, golden: Golden, capsys: pytest.CaptureFixture[str]
) -> None:
    report = import_source(FOLDER / "ecat_project", tmp_path / "project")
    assert (report.sessions, report.findings) == (len(AS_ECAT_PROJECT), ())
    for path in find_sessions(tmp_path / "project"):
        check_session(golden, f"imported/{path.name}", open_session(path), capsys)


def test_the_shipped_ecat_project_exports_to_the_same_bytes(tmp_path: Path) -> None:
    import_source(FOLDER / "ecat_project", tmp_path / "project")
    export(tmp_path / "project", tmp_path / "back", format="ecat-2018")
    for path in sorted((FOLDER / "ecat_project").rglob("*")):
        if path.is_file():
            assert (
                tmp_path / "back" / path.relative_to(FOLDER / "ecat_project")
            ).read_bytes() == path.read_bytes()


def test_the_shipped_recording_gives_poses_near_the_truth_and_the_events_as_ever(
    tmp_path: Path, golden: Golden
) -> None:
    source = FOLDER / "recorded" / WITH_PIXELS
    assert import_source(source, tmp_path / "session").findings == ()
    process_session(tmp_path / "session", smooth=True, prototypes=read_prototypes(source / "boxes.json"))
    session = open_session(tmp_path / "session")
    for name in ("markers_2d", "event_proposals", "relation_proposals"):
        golden.check(f"recorded/{name}.txt", table_text(session.table(name).to_arrow(), 1))
    told = {row["name"]: row["object_id"] for row in truth_table("prototypes").to_pylist()}
    ids = {row["object_id"]: told[row["name"]] for row in session.objects.to_arrow().to_pylist()}
    images = truth_table("image_poses").filter(pc.field("stream") == "color").to_pylist()
    real = {(row["image"], row["object_id"]): row for row in images}
    found = [row for row in session.table("poses_smooth").to_arrow().to_pylist() if row["x"] is not None]
    assert len(found) > 0.95 * len(real)
    here = seen_from_camera(session.table("table_plane").to_arrow(), found)
    there = seen_from_camera(
        truth_table("table_plane"), [real[row["frame"], ids[row["object_id"]]] for row in found]
    )
    assert np.median(np.linalg.norm(here - there, axis=1)) < 0.003


def truth_table(name: str) -> pa.Table:
    return pq.read_table(FOLDER / "truth" / WITH_PIXELS / f"{name}.parquet")


def seen_from_camera(plane: pa.Table, poses: list[dict[str, Any]]) -> Floats:
    """Places (n, 3) on the table, in the depth camera's frame: the origin of the table's is nobody's truth."""
    (table,) = plane.to_pylist()
    frame = Rigid.from_quaternion(
        np.array([table[f"q{axis}"] for axis in "xyzw"]),
        np.array([table[f"origin_{axis}"] for axis in "xyz"]),
    )
    return frame.apply(np.array([[row[axis] for axis in "xyz"] for row in poses]))


def test_the_stages_place_the_sample_as_ever(tmp_path: Path, golden: Golden) -> None:
    import_source(FOLDER / "ecat_project" / "slide_next", tmp_path / "session")
    process_session(tmp_path / "session")
    session = open_session(tmp_path / "session")
    # a millimetre: solvers differ in the last digits from one linear algebra library to the next
    golden.check("processed/table_plane.txt", table_text(session.table("table_plane").to_arrow(), 2))
    golden.check("processed/poses.txt", table_text(session.table("poses").to_arrow(), 2))
