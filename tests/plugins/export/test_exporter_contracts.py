"""The encoders, exporters and run views pass the conformance tests of their hooks."""

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


class TestTablesOfARun(RunViewContract):
    name = "tables"
