"""``ecat survey``: ask people about stretches of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ecat.cli.output import Output
from ecat.cli.text import columns, count
from ecat.cli.verb import Group, verb

_ROOT = click.argument(
    "path", type=click.Path(path_type=Path), help="The session or project that is asked about."
)
_NAME = click.argument("name", help="The survey's name.")


@verb(
    "new",
    examples=(
        "ecat survey new my_project actions --question 'Which of these describes the video best?' --shuffle 1",
        "ecat survey new my_project quality --question 'How good is the action?' --score 0-10 --tier event",
        "ecat survey new my_session windows --question 'What happens?' --window 0,5,20 --choice push --choice pull",
    ),
)
@_ROOT
@_NAME
@click.option("--question", required=True, help="What people are asked about each stretch.")
@click.option(
    "--choice", "choices", multiple=True, help="An answer to choose; by default the types of the events."
)
@click.option("--score", metavar="LEAST-MOST", help="Ask for a whole number instead, for instance 0-10.")
@click.option("--layer", default="main", show_default=True, help="Ask about the events of this layer.")
@click.option("--tier", help="Only about those of this tier; by default those that are part of no other.")
@click.option("--type", "kind", help="Only about those of this type.")
@click.option("--window", metavar="START,STEP,FRAMES", help="Ask about windows of the recordings instead.")
@click.option("--whole", is_flag=True, help="Ask about each recording as a whole instead.")
@click.option(
    "--shuffle", type=int, metavar="SEED", help="Ask in an order of chance, the same for the same seed."
)
def new(out: Output, path: Path, name: str, **options: Any) -> None:
    """Make a survey of events, of windows, or of whole recordings."""
    from ecat.annotate.surveys import Source, make_survey
    from ecat.model.survey import Survey

    least, most = _numbers(options["score"], "-", 2, "--score") if options["score"] else (0, 10)
    window = tuple(_numbers(options["window"], ",", 3, "--window")) if options["window"] else None
    asked = Survey(
        name=name,
        question=options["question"],
        kind="score" if options["score"] else "choice",
        choices=options["choices"],
        least=least,
        most=most,
    )
    source = Source(
        layer=options["layer"],
        tier=options["tier"],
        type=options["kind"],
        window=window,  # pyright: ignore[reportArgumentType]  three numbers
        whole=options["whole"],
    )
    made = make_survey(path, asked, source, seed=options["shuffle"])
    answers = ", ".join(made.choices) or f"{made.least} to {made.most}"
    text = f"survey {name}: {count(len(made.items), 'item')}, answers: {answers}\ntry: ecat annotate {path}"
    out.result({"survey": name, "items": len(made.items), "choices": list(made.choices)}, text)


@verb("list", examples=("ecat survey list my_project",))
@_ROOT
def list_(out: Output, path: Path) -> None:
    """List the surveys and how many answers they have."""
    from ecat.annotate.surveys import last_answers
    from ecat.store.surveys import read_answers, read_survey, survey_names

    found: list[dict[str, Any]] = []
    for name in survey_names(path):
        survey, answers = read_survey(path, name), last_answers(read_answers(path, name))
        raters = sorted({said.rater for said in answers})
        found.append(
            {"name": name, "question": survey.question, "items": len(survey.items), "answers": len(answers)}
            | {"raters": raters}
        )
    rows = [
        [row["name"], count(row["items"], "item"), count(row["answers"], "answer"), ", ".join(row["raters"])]
        for row in found
    ]
    out.result({"surveys": found}, columns(rows) or "no surveys")


@verb(
    "answer",
    examples=(
        "ecat survey answer my_project actions 0 push --rater ann",
        "ecat survey answer my_project quality 3 8 --rater ben --comment 'a bit late'",
    ),
)
@_ROOT
@_NAME
@click.argument("item", help="The item's number.")
@click.argument("said", metavar="ANSWER", help="The choice, or the number.")
@click.option("--rater", required=True, help="Who answers.")
@click.option("--comment", default="", help="What else there is to say.")
def answer(out: Output, path: Path, name: str, item: str, said: str, rater: str, comment: str) -> None:
    """Answer one item of a survey; a later answer replaces an earlier one of the same person."""
    from ecat.annotate import surveys

    given = surveys.answer(path, name, item, rater=rater, said=said, comment=comment)
    out.result(
        {"item": given.item, "rater": given.rater, "answer": given.answer}, f"item {item}: {given.answer}"
    )


@verb(
    "results",
    examples=(
        "ecat survey results my_project actions",
        "ecat survey results my_project actions -o answers.csv",
    ),
)
@_ROOT
@_NAME
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Also write a table, .csv or .parquet.",
)
def results(out: Output, path: Path, name: str, output: Path | None) -> None:
    """Say how the answers agree with each other and with the truth; write them as a table."""
    from ecat.annotate import surveys

    summary = surveys.summarize(path, name)
    lines = [surveys.summary_text(summary)]
    if output is not None:
        surveys.write_results(surveys.results(path, name), output)
        lines.append(f"wrote {output}")
        summary["file"] = str(output)
    out.result(summary, "\n".join(lines))


def _numbers(text: str, separator: str, n: int, option: str) -> list[int]:
    parts = text.split(separator)
    if len(parts) != n or not all(part.strip().isdecimal() for part in parts):
        message = f"{text!r} is not {n} whole numbers with {separator!r} between"
        raise click.BadParameter(message, param_hint=option)
    return [int(part) for part in parts]


command = Group(
    "survey",
    (new, list_, answer, results),
    """Ask people about stretches of recordings: which description fits best, or how good is it.

    People answer on the page (`ecat annotate PATH`) or with `ecat survey answer`; the results are a table, with
    kappa, the confusion with the truth, and the scores.
    """,
    examples=(
        "ecat survey new my_project actions --question 'What happens?'",
        "ecat survey results my_project actions",
    ),
)
