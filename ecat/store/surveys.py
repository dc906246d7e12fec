"""Surveys on disk, in the folder of the project or session that they ask about.

surveys/<name>/survey.json      what is asked
surveys/<name>/answers.jsonl    one line per answer, on the disk before it is acknowledged
"""

from __future__ import annotations

import secrets
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

from ecat.errors import ExistsError, NotFoundError, SchemaError, UsageError
from ecat.model.survey import Survey, SurveyAnswer
from ecat.store import files
from ecat.store.lines import append_line, read_lines
from ecat.store.manifest import is_file_name

FOLDER = "surveys"
MAX_BYTES = 64 << 20

T = TypeVar("T", Survey, SurveyAnswer)


@cache
def _adapter(kind: type[T]) -> TypeAdapter[T]:
    return TypeAdapter(with_config(ConfigDict(extra="forbid", allow_inf_nan=False))(kind))


def survey_names(root: Path) -> list[str]:
    """The surveys of the project or session at ``root``, in order."""
    folder = root / FOLDER
    if not folder.is_dir():
        return []
    return sorted(path.stem for path in folder.glob("*.json") if is_file_name(path.stem))


def write_survey(root: Path, survey: Survey) -> None:
    """Write a new survey, whole or not at all.

    Raises
    ------
    ExistsError : there is one of that name.
    UsageError : the name cannot be that of a file.
    """
    path = _path(root, survey.name)
    if path.exists():
        raise ExistsError(
            f"cannot make survey {survey.name}",
            where=f"{path}: there is one of that name",
            consequence="it was left as it is",
            fix="choose another name",
        )
    new = path.with_name(f".{path.name}.{secrets.token_hex(8)}.new")
    with files.typed_errors(f"cannot make survey {survey.name}", path, "nothing was written"):
        files.make_folder(path.parent)
        with files.NewFile(new) as file:
            file.write(_adapter(Survey).dump_json(survey, indent=2, exclude_defaults=True) + b"\n")
        files.sync(new)
        files.rename(new, path)
        files.sync(path.parent)
        files.sync(root)


def read_survey(root: Path, name: str) -> Survey:
    """The survey called ``name``.

    Raises
    ------
    NotFoundError : there is none.
    SchemaError : the file is not a survey.
    """
    path = _path(root, name)
    if not path.is_file():
        known = ", ".join(survey_names(root)) or "none"
        where = f"{root}: the surveys are: {known}"
        raise NotFoundError(f"cannot read survey {name}", where=where, fix="name one of them")
    with files.typed_errors(f"cannot read survey {name}", path):
        data = files.read_bytes(path, MAX_BYTES)
    return _valid(Survey, data, path)


def append_answer(root: Path, name: str, answer: SurveyAnswer) -> None:
    """Append an answer; when this returns, it is on the disk."""
    append_line(_path(root, name, ".answers.jsonl"), _adapter(SurveyAnswer).dump_python(answer))


def read_answers(root: Path, name: str) -> list[SurveyAnswer]:
    """All answers, the oldest first.

    Raises
    ------
    CorruptError, SchemaError : a line is not an answer.
    """
    path = _path(root, name, ".answers.jsonl")
    return [_valid(SurveyAnswer, line, path) for line in read_lines(path)]


def _path(root: Path, name: str, ending: str = ".json") -> Path:
    if not is_file_name(name):
        fix = "take letters, digits, '_', '-', '.' and spaces"
        raise UsageError(f"cannot use survey {name!r}", where="not a survey's name", fix=fix)
    return files.confined(root, f"{FOLDER}/{name}{ending}")


def _valid(kind: type[T], data: bytes | dict[str, Any], path: Path) -> T:
    try:
        if isinstance(data, bytes):
            return _adapter(kind).validate_json(data)
        return _adapter(kind).validate_python(data)
    except ValidationError as error:
        problems = tuple(
            f"{path}: {'.'.join(map(str, e['loc'])) or 'the document'}: {e['msg']}"
            for e in error.errors()[:20]
        )
        raise SchemaError(
            f"cannot read {path.name}",
            problems=problems,
            consequence="the survey was not read",
            fix="correct the file, or restore it from a copy",
        ) from None
