"""What verbs share that work on many sessions: how many at once, which share of them, and where."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click


def spread_options(work: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``--jobs``, ``--shard`` and ``--engine``; ``work`` says what is done with a session ("Process")."""

    def add(run: Callable[..., Any]) -> Callable[..., Any]:
        for option in (
            click.option(
                "--engine",
                type=click.Choice(["processes", "ray"]),
                default="processes",
                show_default=True,
                help="Processes of this machine; or tasks of the Ray cluster at $RAY_ADDRESS, else of a local one.",
            ),
            click.option(
                "--shard",
                metavar="I/N",
                help=f"{work} only the I-th of N shares of the sessions, as one job of an array.",
            ),
            click.option(
                "--jobs",
                type=click.IntRange(1, 256),
                metavar="N",
                help=f"{work} N sessions at once. "
                "[default: 1 for up to three sessions, else one for each processor]",
            ),
        ):
            run = option(run)
        return run

    return add
