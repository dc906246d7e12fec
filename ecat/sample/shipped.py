"""``sample_sessions/``: what the project ships to try things on and to test with.  ``python -m ecat.sample.shipped``.

``sessions/<name>/`` are sessions of ecat, ``truth/<name>/`` what really happened in them; ``ecat_project/`` is the
first two as the annotator of 2015-2018 would have written them.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from ecat import formats
from ecat.model import ProjectManifest
from ecat.sample.session import sample_session
from ecat.sample.truth_tables import write_truth
from ecat.store import create_project, create_session

FOLDER = Path(__file__).resolve().parents[2] / "sample_sessions"
SESSIONS = {
    "slide_next": (1, ("next",)),
    "slide_around": (2, ("around",)),
    "slide_past_toward_away": (3, ("past", "toward", "away")),
}
"""Name of a shipped session -> its seed and what happens in it."""
AS_ECAT_PROJECT = ("slide_next", "slide_around")
CREATED = "2024-03-05T10:00:00"


def write_shipped(dest: Path) -> None:
    """Make the sample sessions in ``dest``, a folder that must not hold them yet."""
    old = dest / "for_export"
    manifest = ProjectManifest(name="sessions", created=CREATED)
    create_project(dest / "sessions", manifest)
    create_project(old, manifest)
    for name, (seed, actions) in SESSIONS.items():
        draft, truth = sample_session(seed=seed, actions=actions, name=name)
        create_session(dest / "sessions" / name, draft)
        write_truth(dest / "truth" / name, truth)
        if name in AS_ECAT_PROJECT:
            create_session(old / name, draft)
    formats.export(old, dest / "ecat_project", format="ecat-2018")
    shutil.rmtree(old)


def main() -> None:
    """Write ``sample_sessions/`` anew."""
    for name in ("sessions", "truth", "ecat_project"):
        shutil.rmtree(FOLDER / name, ignore_errors=True)
    write_shipped(FOLDER)
    sys.stdout.write(f"{FOLDER.name}: {', '.join(SESSIONS)}\n")


if __name__ == "__main__":
    main()
