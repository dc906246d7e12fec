"""Are the values in the manifest such as things have: cameras, and prototypes of boxes."""

from __future__ import annotations

from collections.abc import Iterator

from ecat.check.finding import Finding, Patient, error
from ecat.errors import SchemaError
from ecat.model.prototype import BoxPrototype
from ecat.model.session import camera_problems


def cameras(patient: Patient) -> Iterator[Finding]:
    """Cameras have a focal length, a lens and a place."""
    for i, camera in enumerate(patient.manifest.cameras):
        for problem in camera_problems(camera):
            yield error("camera-value", f"camera {camera.name}", f"cameras[{i}].{problem}")


def prototypes(patient: Patient) -> Iterator[Finding]:
    """The boxes kept in the session are boxes."""
    for i, box in enumerate(patient.manifest.prototypes):
        try:
            BoxPrototype.from_dict(box)
        except SchemaError as reason:
            for problem in reason.problems:
                yield error("prototype-value", "session.json", f"prototypes[{i}].{problem}")


MANIFEST = (cameras, prototypes)
