"""``sample_sessions/``: what the project ships to try things on and to test with.  ``python -m ecat.sample.shipped``.

``sessions/<name>/`` are sessions of ecat, ``recorded/<name>/`` is what the cameras of another one wrote, with the boxes
in ``boxes.json``; ``truth/<name>/`` is what really happened in them; ``ecat_project/`` is the first two sessions as the
annotator of 2015-2018 would have written them.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from ecat import formats
from ecat.checkout import checkout_folder
from ecat.errors import EcatError
from ecat.model import Manifest, ProjectManifest
from ecat.process import write_prototypes
from ecat.sample.recording import sample_recording
from ecat.sample.session import sample_session
from ecat.sample.truth_tables import write_truth
from ecat.store import create_project, create_session, write_new_file

SESSIONS = {
    "slide_next": (1, ("next",)),
    "slide_around": (2, ("around",)),
    "slide_past_toward_away": (3, ("past", "toward", "away")),
}
"""Name of a shipped session -> its seed and what happens in it."""
WITH_PIXELS = "slide_toward"
"""The shipped recording: few and small images, so that a checkout stays light."""
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


def write_recording(dest: Path) -> None:
    """Make the sample recording in ``dest``, a folder that must not hold it yet."""
    recording = sample_recording(
        seed=5,
        actions=("toward",),
        name=WITH_PIXELS,
        size=(960, 540),
        depth_size=(256, 212),
        depth_every=2,
        qp=22,
    )
    raw = dest / "recorded" / WITH_PIXELS
    with TemporaryDirectory() as folder:
        session = create_session(Path(folder) / WITH_PIXELS, recording.draft)
        shutil.copytree(session.path / "media", raw)
        write_new_file(raw / "camera.json", [calibration_json(session.manifest)])
        write_prototypes(raw / "boxes.json", recording.truth.prototypes)
    write_truth(dest / "truth" / WITH_PIXELS, recording.truth, recording.image_truth())


def calibration_json(manifest: Manifest) -> bytes:
    """The cameras of a session as the ``camera.json`` of a folder of videos."""
    document: dict[str, object] = {"depth_unit_m": 0.001}
    for camera in manifest.cameras:
        names = ("fx", "fy", "cx", "cy")
        document[camera.name] = {
            "width": camera.width_px,
            "height": camera.height_px,
            **{name: round(getattr(camera, f"{name}_px"), 6) for name in names},
            "mirrored": camera.mirrored,
            "rotation": camera.rotation,
            "translation_m": camera.translation_m,
        }
    return (json.dumps(document, indent=2) + "\n").encode()


def main() -> None:
    """Write ``sample_sessions/`` anew.

    Raises
    ------
    UsageError : there is no checkout to write into.
    """
    folder = checkout_folder("sample_sessions")
    for name in ("sessions", "recorded", "truth", "ecat_project"):
        shutil.rmtree(folder / name, ignore_errors=True)
    write_shipped(folder)
    write_recording(folder)
    sys.stdout.write(f"{folder.name}: {', '.join([*SESSIONS, WITH_PIXELS])}\n")


if __name__ == "__main__":
    try:
        main()
    except EcatError as failed:
        sys.exit(f"ecat: {failed}")
