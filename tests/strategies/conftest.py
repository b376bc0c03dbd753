"""A training run that several test modules of strategies share."""

from __future__ import annotations

import pytest

from merap.runs.run_folder import RunFolder
from tests.support.trained_runs import ONE_OF_SIXTEEN, SMALL, trained


@pytest.fixture(scope="session")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Five updates: where only the machinery matters. It samples episodes without exploration."""
    config = SMALL.model_copy(update={"exploration": 0.0})
    return trained(tmp_path_factory.mktemp("runs") / "hasty", config, ONE_OF_SIXTEEN)
