"""``ecat sample``: a session that never was, to try things on."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.verb import verb


@verb(
    "sample",
    examples=(
        "ecat sample my_session",
        "ecat sample my_session --seed 7 --actions next,around --truth my_truth",
    ),
)
@click.argument("dest", type=click.Path(path_type=Path), help="The folder to make.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Another seed, another scene."
)
@click.option(
    "--actions",
    metavar="NAME,...",
    help="What happens: next, past, around, toward, away; all of them by default.",
)
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Where to write what really happened; DEST_truth by default.",
)
def command(out: Output, dest: Path, seed: int, actions: str | None, truth: Path | None) -> None:
    """Make a small session with exactly known truth.

    Two marked boxes on a table, a performer who slides one next to, past, around, toward or away from the
    other, noisy markers and joints, events and relations.  The same seed gives the same session; there are no
    images.
    """
    from ecat import sample, store

    wanted = sample.ACTIONS if actions is None else [name.strip() for name in actions.split(",")]
    draft, ground_truth = sample.sample_session(seed=seed, actions=wanted, name=dest.resolve().name)
    session = store.create_session(dest, draft)
    truth = truth if truth is not None else dest.resolve().with_name(f"{dest.resolve().name}_truth")
    sample.write_truth(truth, ground_truth)
    data = {
        "path": str(dest),
        "name": session.name,
        "seed": seed,
        "truth": str(truth),
    }
    out.result(
        data,
        f"made session {session.name} in {dest}\nwhat really happened: {truth.name}\ntry: ecat info {dest}",
    )
