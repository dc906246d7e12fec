"""Samples that several tests look at."""

from __future__ import annotations

import pytest

from ecat.sample import NOISELESS, sample_session
from tests.sample.samples import Sample


@pytest.fixture(scope="session", params=[0, 1, 2])
def sample(request: pytest.FixtureRequest) -> Sample:
    """All five actions, seen by ordinary sensors."""
    return Sample(*sample_session(seed=request.param))


@pytest.fixture(scope="session")
def noiseless() -> Sample:
    """All five actions, seen by perfect sensors."""
    return Sample(*sample_session(seed=0, noise=NOISELESS))
