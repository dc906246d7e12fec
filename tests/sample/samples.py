"""A sample session as the tests look at it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import pyarrow as pa

from ecat.model import Layer
from ecat.sample import GroundTruth
from ecat.store import Draft


@dataclass(frozen=True, eq=False)
class Sample:
    """The session and its truth."""

    draft: Draft
    truth: GroundTruth

    @cached_property
    def layer(self) -> Layer:
        return self.draft.layers[0]

    def table(self, name: str) -> pa.Table:
        data = self.draft.tables[name].data
        assert isinstance(data, pa.Table)
        return data
