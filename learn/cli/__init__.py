"""``ecat learn``: features, recognisers and what else is learned from sessions; a verb that this package adds."""

from __future__ import annotations

from ecat.cli.verb import Group
from learn.cli.qsr import qsr
from learn.cli.recognize import recognize

learn = Group(
    "learn",
    [qsr],
    """Learn from sessions, and compute what learners are fed.""",
    examples=("ecat learn qsr tracks.parquet --relation cardir -o cardir.parquet",),
)
learn.add_command(recognize)
