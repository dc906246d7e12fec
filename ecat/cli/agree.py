"""``ecat agree``: how far annotators agree."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.cli.verb import verb

if TYPE_CHECKING:
    import pandas as pd

TABLES = (".csv", ".parquet")


@verb(
    "agree",
    examples=(
        "ecat agree my_session --layer ann --layer ben",
        "ecat agree anns_project bens_project",
        "ecat agree answers.csv --truth true_label",
        "ecat agree scores.csv --item clip --rater judge --answer score --level interval",
    ),
)
@click.argument(
    "paths",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    help="A session or project whose layers are compared; or two or more, by the names of their sessions; or a "
    "table of ratings (CSV, Parquet).",
)
@click.option(
    "--layer",
    "layers",
    multiple=True,
    metavar="LAYER",
    help="A layer to compare; give it once for each. All that people made by default; of several projects: main.",
)
@click.option(
    "--item", "item", multiple=True, metavar="COLUMN", help="Of ratings: the column of what was rated."
)
@click.option("--rater", metavar="COLUMN", help="Of ratings: the column of who rated.")
@click.option("--answer", metavar="COLUMN", help="Of ratings: the column of what they said.")
@click.option(
    "--truth", metavar="COLUMN", help="Of ratings: the column of what is right, for the confusion matrix."
)
@click.option(
    "--blank", metavar="LABEL", help="Of ratings: what an empty answer stands for; no answer by default."
)
@click.option(
    "--level",
    type=click.Choice(["nominal", "ordinal", "interval"]),
    default="nominal",
    show_default=True,
    help="Of ratings: names, ordered numbers, or numbers, for Krippendorff's alpha.",
)
def command(out: Output, paths: tuple[Path, ...], layers: tuple[str, ...], **columns: Any) -> None:
    """Say how far annotators agree.

    Of annotated sessions: Cohen's and Fleiss' kappa and Krippendorff's alpha of the labels by frame, F1 of the events
    at several overlaps (nested ones by depth), the errors of their edges, parents, roles, objects and relations.  Of a
    table of ratings: the same coefficients, and the confusion with the truth.
    """
    if len(paths) == 1 and paths[0].suffix.lower() in TABLES:
        _ratings(out, paths[0], columns)
    else:
        _layers(out, paths, layers)


def _layers(out: Output, paths: tuple[Path, ...], layers: tuple[str, ...]) -> None:
    from ecat.annotate import agreement

    with out.progress() as progress:
        compared = agreement.agree(paths, layers, progress=progress)
    found = agreement.figures(compared.agreement)
    lines = [agreement.text_of(found)]
    for why, sessions in agreement.reasons(compared.left_out):
        lines.append(f"left out: {count(sessions, 'session')}: {why}")
    left_out = [{"session": name, "reason": why} for name, why in compared.left_out]
    out.result(found | {"left_out": left_out}, "\n".join(lines))


def _ratings(out: Output, path: Path, options: dict[str, Any]) -> None:
    from ecat.annotate import agreement

    named = agreement.Columns(**{name: options[name] for name in ("item", "rater", "answer", "truth")})
    found = agreement.rated_figures(_table(path), named, blank=options["blank"], level=options["level"])
    out.result(found, agreement.ratings_text(found))


def _table(path: Path) -> pd.DataFrame:
    import pandas as pd

    from ecat.errors import FormatError
    from ecat.store import files

    with files.typed_errors(f"cannot read {path.name}", path):
        files.open_regular(path).close()
        try:
            if path.suffix.lower() == ".parquet":
                return pd.read_parquet(path)
            return pd.read_csv(path, dtype="string", keep_default_na=False)
        except (ValueError, OSError) as error:
            raise FormatError(
                f"cannot read {path.name}",
                where=f"{path}: {str(error).splitlines()[0]}",
                consequence="nothing was computed",
                fix="give a table with a line of column names",
            ) from None
