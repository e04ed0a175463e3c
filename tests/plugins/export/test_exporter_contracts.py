"""The encoders, exporters and run views pass the conformance tests of their hooks."""

import pytest
from opir_testing import EncoderContract, ExporterContract, RunViewContract

from opir_core.plugin import ExporterModel, Host


class TestForgeC2Encoder(EncoderContract):
    name = "forge-c2"


class TestUdlEncoder(EncoderContract):
    name = "udl"


class TestExporters(ExporterContract):
    @pytest.fixture(autouse=True, params=sorted(Host.discover().names(ExporterModel)))
    def named(self, request: pytest.FixtureRequest) -> None:
        type(self).name = request.param


class TestTablesOfARun(RunViewContract):
    name = "tables"
