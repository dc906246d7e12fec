"""``ecat learn``: features, recognisers and what else is learned from sessions; a verb that this package adds."""

from __future__ import annotations

from ecat.cli.verb import Group
from learn.cli.features import features
from learn.cli.qsr import qsr
from learn.cli.recognize import recognize
from learn.cli.recognize_predict import predict

learn = Group(
    "learn",
    [qsr, features],
    """Learn from sessions, and compute what learners are fed.""",
    examples=(
        "ecat learn qsr tracks.parquet --relation cardir -o cardir.parquet",
        "ecat learn features my_session --set ch5-qualitative -o features.parquet",
        "ecat learn recognize train exports --run runs/first --model trees",
    ),
)
recognize.add_command(predict)
learn.add_command(recognize)
