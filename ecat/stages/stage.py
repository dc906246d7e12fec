"""What a stage is: a named, versioned, pure function from Arrow tables and images to Arrow tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import pyarrow as pa

from ecat.stages.images import ImagesByKind

Tables: TypeAlias = Mapping[str, Any]
"""Tables by their names; those that the stage reads partly as :class:`ecat.stages.rows.Rows`."""


def _all(parameters: Any) -> Any:
    return parameters


@dataclass(frozen=True)
class Stage:
    """A step of the pipeline.

    Parameters
    ----------
    name, version : recorded with every result; a change of either makes stored results stale.
    inputs, images : tables it reads, and kinds of streams (color, depth) it looks at; ``optional`` ones may be missing
        from what ``run`` is given.
    partly : inputs of which it reads some columns, or some frames at a time.
    outputs : tables it makes.
    parameters : the frozen dataclass of its parameters, every field with a default.
    run : the function itself; it opens no file and keeps no state.
    parts : the same for its only output, of which an hour is large: its rows as they are made, some at a time.
    recorded : what of the parameters the result depends on; all of them unless said otherwise.
    """

    name: str
    version: int
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: type
    run: Callable[[Tables, ImagesByKind, Any], dict[str, pa.Table]]
    optional: tuple[str, ...] = ()
    images: tuple[str, ...] = ()
    partly: tuple[str, ...] = ()
    parts: Callable[[Tables, ImagesByKind, Any], Iterator[pa.Table]] | None = None
    recorded: Callable[[Any], Any] = _all
