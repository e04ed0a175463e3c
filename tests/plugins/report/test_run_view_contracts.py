"""The run views pass the conformance tests of their hook."""

import pytest
from opir_testing import RunViewContract


class TestPlots(RunViewContract):
    name = "plot"


@pytest.mark.slow
class TestMap(RunViewContract):
    name = "map"


@pytest.mark.slow
class TestReport(RunViewContract):
    name = "report"


class TestSave(RunViewContract):
    name = "save"


class TestScore(RunViewContract):
    name = "score"
