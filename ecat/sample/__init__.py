"""Small sessions that ecat makes itself, with exact truth: two marked cubes, a table, a performer, no pixels.

``sample_session`` makes one; ``write_truth`` keeps what really happened.  Tests and examples stand on them.
"""

from __future__ import annotations

from ecat.sample.annotation import SCHEME
from ecat.sample.script import ACTIONS
from ecat.sample.sensor import NOISELESS, NoiseModel
from ecat.sample.session import sample_session
from ecat.sample.truth import GroundTruth
from ecat.sample.truth_tables import ground_truth_tables, write_truth

__all__ = [
    "ACTIONS",
    "NOISELESS",
    "SCHEME",
    "GroundTruth",
    "NoiseModel",
    "ground_truth_tables",
    "sample_session",
    "write_truth",
]
