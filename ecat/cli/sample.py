"""``ecat sample``: a session that never was, to try things on."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.text import shell
from ecat.cli.verb import verb
from ecat.errors import UsageError


@verb(
    "sample",
    examples=(
        "ecat sample my_session",
        "ecat sample my_session --seed 7 --actions next,around --truth my_truth",
        "ecat sample my_session --actions next --pixels --size 960x540 --cameras 2",
    ),
)
@click.argument("dest", type=click.Path(path_type=Path), help="The folder to make.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    metavar="NUMBER",
    default=0,
    show_default=True,
    help="Another seed, another scene.",
)
@click.option(
    "--actions",
    metavar="NAME,...",
    help="What happens: next, past, around, toward, away; each once by default, at most 100 in all.",
)
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Where to write what really happened; DEST_truth by default.",
)
@click.option(
    "--pixels", is_flag=True, help="Render colour and depth video and sound, and leave out the markers."
)
@click.option("--size", metavar="WxH", help="Of colour images, even numbers; 1920x1080 by default.")
@click.option(
    "--cameras", type=click.IntRange(1, 2), metavar="NUMBER", help="Colour cameras: 1, the default, or 2."
)
@click.option(
    "--mirrored/--no-mirrored",
    default=None,
    help="Whether images are delivered left for right; as from a Kinect by default.",
)
def command(
    out: Output,
    dest: Path,
    seed: int,
    actions: str | None,
    truth: Path | None,
    *,
    pixels: bool,
    size: str | None,
    cameras: int | None,
    mirrored: bool | None,
) -> None:
    """Make a small session with exactly known truth.

    Two marked boxes on a table, a performer who slides one next to, past, around, toward or away from the
    other, noisy markers and joints, events and relations.  The same seed gives the same session.

    With --pixels, what cameras would have seen of it instead of markers: colour video, depth as from a time-of-flight
    camera, a beep where an event begins, each stream with a clock of its own.
    """
    from ecat import sample, store

    wanted = sample.ACTIONS if actions is None else [name.strip() for name in actions.split(",")]
    name = dest.resolve().name
    truth = truth or dest.resolve().with_name(f"{name}_truth")
    _keep_apart(dest, truth)
    if not pixels and (size, cameras, mirrored) != (None, None, None):
        where = "--size, --cameras and --mirrored are about images"
        raise UsageError(f"cannot make {dest}", where=where, fix="add --pixels, or leave them out")
    # the one in the block of the other: both appear, or neither does
    with out.progress() as progress, store.staged_folder(truth) as staging:
        if pixels:
            from ecat.sample.recording import sample_recording

            recording = sample_recording(
                seed=seed,
                actions=wanted,
                name=name,
                size=_size(size),
                cameras=cameras or 1,
                mirrored=mirrored is not False,
                progress=progress,
            )
            sample.write_truth(staging, recording.truth, recording.image_truth(progress))
            session = store.create_session(dest, recording.draft)
        else:
            draft, ground_truth = sample.sample_session(seed=seed, actions=wanted, name=name)
            sample.write_truth(staging, ground_truth)
            session = store.create_session(dest, draft)
    data = {
        "path": str(dest),
        "name": session.name,
        "seed": seed,
        "truth": str(truth),
    }
    text = f"made session {session.name} in {dest}\nwhat really happened: {truth}"
    out.result(data, f"{text}\ntry: {shell('ecat', 'info', dest)}")


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not (width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
        raise UsageError(
            f"cannot read --size {text}", where="expected WIDTHxHEIGHT", fix="give --size 1920x1080"
        )
    return int(width[:9]), int(height[:9])


def _keep_apart(dest: Path, truth: Path) -> None:
    session, answers = dest.resolve(), truth.resolve()
    if session.is_relative_to(answers) or answers.is_relative_to(session):
        raise UsageError(
            f"cannot make {dest}",
            where=f"--truth {truth}: one of the two would lie inside of the other",
            fix="leave --truth out, or name a folder beside the session",
        )
