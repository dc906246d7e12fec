"""Block poses on the real Kinect sessions, measured by the yardstick of the reference data.

    python benchmarks/poses.py [--shared ../shared]

Imports the three sessions, calibrates the boxes, places them frame by frame without smoothing, and prints the
yardstick's figures (how still a standing block stands; the pipeline of 2017 over the same demonstrations is the
baseline) three times: boxes calibrated on all three sessions together, on each session by itself, and on the other
two sessions only.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ecat.formats import export, import_source
from ecat.process import calibrate, process_session
from ecat.store import find_sessions, open_session


def placed(project: Path, prototypes: Callable[[Path], Any], out: Path) -> float:
    """Place the blocks of every session with ``prototypes(session)`` and export them; the seconds it took."""
    started = time.perf_counter()
    for path in find_sessions(project):
        process_session(path, prototypes=prototypes(path), force=True)
    took = time.perf_counter() - started
    export(project, out, format="poses")
    return took


def yardstick(shared: Path, poses: Path) -> dict[str, Any]:
    """The figures of ``tools/static_jitter.py``."""
    data = shared / "data" / "demonstrations_ch5" / "demonstrations"
    command = [
        sys.executable,
        str(shared / "tools" / "static_jitter.py"),
        str(poses),
        "--data",
        str(data),
        "--json",
    ]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def reprojection_px(project: Path) -> float:
    """Median over frames of the RMS reprojection error."""
    found = [
        np.asarray(open_session(path).poses.to_arrow()["residual_px"].drop_null())
        for path in find_sessions(project)
    ]
    return float(np.median(np.concatenate(found)))


def show(title: str, figures: dict[str, Any], residual: float, seconds: float) -> None:
    """Print one line."""
    all_, still = figures["candidate"], figures["candidate_without_nudged"]
    columns = ("median_rms_mm", "mean_rms_mm", "p90_rms_mm", "beyond_30mm_pct", "angle_p95_deg", "coverage")
    cells = [
        title,
        *(all_[name] for name in columns),
        still["mean_rms_mm"],
        f"{residual:.2f}",
        f"{seconds:.1f}",
    ]
    print("| " + " | ".join(map(str, cells)) + " |")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shared", type=Path, default=Path(__file__).resolve().parents[2] / "shared")
    shared: Path = parser.parse_args().shared
    if not (shared / "data" / "ecat_kinect").is_dir():
        print(f"skipped: the reference data is not at {shared}")
        return
    with tempfile.TemporaryDirectory() as name:
        project, out = Path(name) / "project", Path(name) / "poses.parquet"
        import_source(shared / "data" / "ecat_kinect", project)
        sessions = find_sessions(project)
        started = time.perf_counter()
        together = calibrate(sessions)
        calibrated = time.perf_counter() - started
        others = {path: calibrate([p for p in sessions if p != path]) for path in sessions}
        alone = {path: calibrate([path]) for path in sessions}
        print(
            "| boxes calibrated on | median mm | mean | 90 % | > 30 mm % | angle deg | coverage "
            "| mean, not nudged | px | s |"
        )
        print("|---|---|---|---|---|---|---|---|---|---|")
        seconds = placed(project, lambda _: together, out) + calibrated
        figures = yardstick(shared, out)
        base = figures["baseline_2017"]
        print(
            f"| pipeline of 2017 | {base['median_rms_mm']} | {base['mean_rms_mm']} | {base['p90_rms_mm']} | "
            f"{base['beyond_30mm_pct']} | {base['angle_p95_deg']} | 1 | | | |"
        )
        show("the three sessions", figures, reprojection_px(project), seconds)
        seconds = placed(project, alone.__getitem__, out)
        show("the session itself", yardstick(shared, out), reprojection_px(project), seconds)
        seconds = placed(project, others.__getitem__, out)
        show("the other two sessions", yardstick(shared, out), reprojection_px(project), seconds)
        print(f"\n{pq.read_metadata(out).num_rows} poses; pyarrow {pa.__version__}")


if __name__ == "__main__":
    main()
