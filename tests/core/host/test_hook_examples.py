"""The examples in the docstrings of hooks run as they are written."""

import doctest

from opir_core.host import hookspecs


def test_examples_of_hooks_run() -> None:
    done = doctest.testmod(hookspecs)
    assert done.attempted >= 8
    assert done.failed == 0
