"""The exporters pass the conformance tests of their hook."""

from opir_testing import ExporterContract


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
