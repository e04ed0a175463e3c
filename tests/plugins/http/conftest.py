"""One service for the tests of a module."""

from collections.abc import Iterator

import pytest
from attrs import evolve
from http_service import RunningService, serving
from waiting import until


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with serving(tmp_path_factory.mktemp("stand"), "--speed", "5", "--loop") as running:
        running.service.settings = evolve(running.service.settings, writes_per_s=10_000.0)
        until(lambda: running.service.feed.history.total > 50)
        yield running
