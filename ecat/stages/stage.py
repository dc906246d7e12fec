"""What a stage is: a named, versioned, pure function from Arrow tables to Arrow tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import pyarrow as pa

Tables: TypeAlias = Mapping[str, pa.Table]


@dataclass(frozen=True)
class Stage:
    """A step of the pipeline.

    Parameters
    ----------
    name, version : recorded with every result; a change of either makes stored results stale.
    inputs : tables it reads; ``optional`` ones may be missing from what ``run`` is given.
    outputs : tables it makes.
    parameters : the frozen dataclass of its parameters, every field with a default.
    run : the function itself; it opens no file and keeps no state.
    """

    name: str
    version: int
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: type
    run: Callable[[Tables, Any], dict[str, pa.Table]]
    optional: tuple[str, ...] = ()
