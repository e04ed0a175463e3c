"""The director `stonesoup` passes the conformance tests of its hook."""

import pytest
from opir_testing import DirectorContract


@pytest.mark.slow
class TestStoneSoupDirector(DirectorContract):
    name = "stonesoup"
