"""The encoders, exporters and run views pass the conformance tests of their hooks."""

from collections.abc import Mapping
from typing import Any, ClassVar

from opir_testing import EncoderContract, ExporterContract, RunViewContract


class TestForgeC2Encoder(EncoderContract):
    name = "forge-c2"


class TestUdlEncoder(EncoderContract):
    name = "udl"


class TestParquetExporter(ExporterContract):
    name = "parquet"


class TestArrowExporter(ExporterContract):
    name = "arrow"


class TestCsvExporter(ExporterContract):
    name = "csv"


class TestOemExporter(ExporterContract):
    name = "oem"


class TestTdmExporter(ExporterContract):
    name = "tdm"


class TestGeoJsonExporter(ExporterContract):
    name = "geojson"


class TestKmlExporter(ExporterContract):
    name = "kml"


class TestCzmlExporter(ExporterContract):
    name = "czml"


class TestCuesExporter(ExporterContract):
    name = "cues"
    settings: ClassVar[Mapping[str, Any]] = {"lat_deg": 9.4, "lon_deg": 167.5}
    expected_failures: ClassVar[Mapping[str, str]] = {
        "test_every_run_can_be_written": "a run without a tracker has no cues, and says so"
    }


class TestSceneExporter(ExporterContract):
    name = "scene"


class TestTablesOfARun(RunViewContract):
    name = "tables"
