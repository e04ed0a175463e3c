"""Waiting for what another thread or process does."""

import time
from collections.abc import Callable
from typing import Any


def until(is_so: Callable[[], Any], within_s: float = 60.0) -> None:
    """Wait until something is so; fail where it does not come about."""
    give_up_at = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < give_up_at, "it did not come about"
        time.sleep(0.005)
