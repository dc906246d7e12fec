"""What requests look like; ``web/openapi.json`` is made from these and from :mod:`ecat.web.shapes`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ecat.web.shapes import Json, Shape

Author = Annotated[str, Field(min_length=1, max_length=200)]


class Signed(Shape):
    """Whatever somebody does."""

    author: Author


class Edit(Signed):
    """Operations that are one step of undo, and the revision that they were made for."""

    base: Annotated[int, Field(ge=0)] | None = None
    operations: Annotated[list[Json], Field(min_length=1, max_length=100_000)]


class Step(Signed):
    """Undo or redo of this author's last operation."""

    base: Annotated[int, Field(ge=0)] | None = None


class Restore(Signed):
    """Back to how the layer was at a revision."""

    revision: Annotated[int, Field(ge=0)]


class Save(Shape):
    """Nothing needs to be said."""


class Process(Shape):
    """Stages by name, or all that are out of date."""

    stages: Annotated[list[str], Field(max_length=50)] | None = None
    force: bool = False


class AddSkeletons(Signed):
    """The layer that gets the rigs, and the upload with the file."""

    layer: Annotated[str, Field(min_length=1, max_length=200)]
    upload: Annotated[str, Field(max_length=64)]


class AddFiles(Shape):
    """The upload with the files."""

    upload: Annotated[str, Field(max_length=64)]


class NewProject(Shape):
    """A name, and the way to the project that it is to be in."""

    name: Annotated[str, Field(min_length=1, max_length=200)]
    inside: Annotated[str, Field(max_length=1000)] = ""


class Import(NewProject):
    """What was sent becomes a session or project of this name; ``format`` is found out if not given."""

    upload: Annotated[str, Field(max_length=64)]
    format: Annotated[str, Field(max_length=64)] | None = None


class Removal(Shape):
    """The session's name, to confirm; ``keep``: it goes to the archive, from where it can be brought back."""

    name: Annotated[str, Field(max_length=1000)]
    keep: bool = True


class EditAll(Signed):
    """Operations for many sessions (all of them by default); ``make`` makes the layer where there is none."""

    layer: Annotated[str, Field(min_length=1, max_length=200)]
    operations: Annotated[list[Json], Field(min_length=1, max_length=1000)]
    sessions: Annotated[list[str], Field(max_length=100_000)] | None = None
    make: bool = True


class AnswerShape(Shape):
    """What somebody says about an item of a survey."""

    rater: Annotated[str, Field(min_length=1, max_length=64)]
    item: Annotated[str, Field(max_length=64)]
    answer: Annotated[str, Field(max_length=1000)] | int
    comment: Annotated[str, Field(max_length=10_000)] = ""
