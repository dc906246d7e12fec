"""Parts of a text become an Arrow array as they are, and nothing is made of what lies between them."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.ecat2018.spans import spans, values_of

PARTS = st.lists(st.tuples(st.binary(max_size=3), st.binary(max_size=3)), min_size=1)


@given(PARTS)
def test_parts_and_gaps_take_turns(parts: list[tuple[bytes, bytes]]) -> None:
    """The gaps are null, the one behind the last part is left out."""
    ends = np.cumsum([len(part) + len(gap) for part, gap in parts], dtype=np.intp) - [
        len(gap) for _, gap in parts
    ]
    starts = ends - [len(part) for part, _ in parts]
    found = spans(b"".join(part + gap for part, gap in parts), starts, ends, pa.binary())
    found.validate(full=True)
    assert found.to_pylist() == [x for part, _ in parts for x in (part, None)][:-1]


@given(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=1))
def test_what_a_kernel_makes_of_parts_is_found_without_the_gaps(numbers: list[int]) -> None:
    texts = [b"%d" % number for number in numbers]
    ends = np.cumsum([len(text) + 1 for text in texts], dtype=np.intp) - 1
    found = spans(b"x".join(texts), ends - [len(text) for text in texts], ends, pa.string())
    assert values_of(pc.cast(found, pa.int32()), np.int32).tolist() == numbers
