"""The command `opir export`, exporters, views of runs, event encoders and the sink `parquet`.

pyarrow is imported when a table is made.
"""

from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import Any

from opir_core.plugin import (
    EventEncoder,
    ExporterModel,
    MetricModel,
    RunView,
    SinkModel,
    deferred,
    hookimpl,
)
from opir_export.settings import (
    ArrowConfig,
    CsvConfig,
    CuesConfig,
    CzmlConfig,
    MapConfig,
    OemConfig,
    ParquetConfig,
    ParquetSinkConfig,
    SceneConfig,
    TdmConfig,
)

_SUMMARY = "write a run in a format of other programs: tables, maps, ephemerides"


@hookimpl
def opir_exporters() -> Iterable[ExporterModel]:
    """Yield the exporters."""
    for name, config, module, function, summary in _EXPORTERS:
        build = _exporter(module, function)
        yield ExporterModel(name=name, summary=summary, config=config, build=build)


@hookimpl
def opir_metrics() -> Iterable[MetricModel]:
    """Yield the metric `search_volume`."""
    yield MetricModel(
        name="search_volume",
        summary="volume and area that a sensor on the ground must search for launches, and the share"
        " of volumes that hold them",
        config=CuesConfig,
        build=deferred("opir_export.volume_metric.search_volume_metric"),
    )


def _exporter(module: str, function: str) -> Callable[..., Any]:
    build = deferred(f"opir_export.formats.{module}.{function}")
    return lambda config, _context: build(config)


#: Name, settings, module in `formats`, its function or class, and summary of each exporter.
_EXPORTERS: Sequence[tuple[str, type, str, str, str]] = (
    (
        "parquet",
        ParquetConfig,
        "table_files",
        "parquet_folder",
        "a folder of Parquet files, one for each table, with the manifest among the metadata",
    ),
    (
        "arrow",
        ArrowConfig,
        "table_files",
        "arrow_folder",
        "a folder of Arrow IPC files (Feather), one for each table",
    ),
    ("csv", CsvConfig, "table_files", "csv_folder", "a folder of CSV files, one for each table"),
    (
        "geojson",
        MapConfig,
        "geojson",
        "GeoJsonFile",
        (
            "GeoJSON (RFC 7946): ground tracks, launches, impacts, predicted regions, "
            "what sensors can see"
        ),
    ),
    (
        "kml",
        MapConfig,
        "kml",
        "KmlFile",
        "KML for Google Earth: flights over time, predicted impacts, what sensors can see",
    ),
    (
        "czml",
        CzmlConfig,
        "czml",
        "CzmlFile",
        (
            "CZML for Cesium: flights and satellites over time, predicted impacts, "
            "what sensors can see"
        ),
    ),
    (
        "oem",
        OemConfig,
        "oem",
        "OemFolder",
        "a folder of CCSDS Orbit Ephemeris Messages (KVN), one for each target and sensor",
    ),
    (
        "tdm",
        TdmConfig,
        "tdm",
        "TdmFile",
        "measured angles of each sensor, a CCSDS Tracking Data Message (KVN)",
    ),
    (
        "cues",
        CuesConfig,
        "cues",
        "CuesFile",
        "the volume that another sensor must search for the target of each track, as JSON lines",
    ),
    (
        "scene",
        SceneConfig,
        "scene",
        "RecordedScene",
        "the scene, as YAML; from the changes of a live run with its launches",
    ),
)


@hookimpl
def opir_event_encoders() -> Iterable[EventEncoder]:
    """Yield the encoders `avro`, `forge-c2`, `protobuf` and `udl`."""
    yield EventEncoder(
        name="avro",
        summary="the detection event in Avro's single-object encoding; needs the extra avro",
        build=_encoder("avro", "AvroEncoder"),
        schema=deferred("opir_export.encoders.avro.avro_schema_text"),
    )
    yield EventEncoder(
        name="protobuf",
        summary="the detection event in Protocol Buffers; needs the extra protobuf",
        build=_encoder("protobuf", "ProtobufEncoder"),
        schema=deferred("opir_export.encoders.protobuf.proto_text"),
    )
    yield EventEncoder(
        name="forge-c2",
        summary="a flat record with or without a position, for command-and-control consumers",
        build=_encoder("forge_c2", "ForgeC2Encoder"),
        schema=_schema("forge-c2"),
    )
    yield EventEncoder(
        name="udl",
        summary="a MissileTrack of the Unified Data Library, simulated",
        build=_encoder("udl", "UdlEncoder"),
        schema=_schema("udl"),
    )


def _encoder(module: str, encoder: str) -> Callable[..., Any]:
    """Return a `build` that imports the encoder's module when it is called."""

    def build(_config: Any, context: Any) -> Any:
        return getattr(import_module(f"opir_export.encoders.{module}"), encoder)(context)

    return build


def _schema(name: str) -> Callable[[], str]:
    """Return the function that reads a JSON Schema of this package."""

    def read() -> str:
        from importlib.resources import files

        return (
            files("opir_export").joinpath("data", f"{name}.schema.json").read_text(encoding="utf-8")
        )

    return read


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    """Yield the sink `parquet`."""
    yield SinkModel(
        name="parquet",
        summary="detections as columns of a Parquet file",
        config=ParquetSinkConfig,
        build=deferred("opir_export.parquet_sink.parquet_sink"),
        read=deferred("opir_export.parquet_events.parquet_events"),
        open_truth=deferred("opir_export.parquet_truth.ParquetTruth"),
        read_truth=deferred("opir_export.parquet_truth.read_truth"),
    )


@hookimpl
def opir_run_views() -> Iterable[RunView]:
    """Yield the tables of a run in three forms."""
    of_tables = {
        "tables": "Arrow tables by name",
        "pandas": "data frames of pandas",
        "polars": "data frames of polars",
    }
    for name, summary in of_tables.items():
        function = name if name == "tables" else f"to_{name}"
        yield RunView(
            name=name, summary=summary, build=deferred(f"opir_export.tabular.run_tables.{function}")
        )


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir export`."""
    parser = commands.add_parser("export", help=_SUMMARY)
    parser.add_argument(
        "path", metavar="RUN", nargs="?", help="the events, folder or changes of a run"
    )
    parser.add_argument("--to", metavar="FORMAT", help="an exporter; --list lists them")
    parser.add_argument(
        "-o",
        "--out",
        metavar="PATH",
        help="the file, or the folder of a format with several (default: beside the run)",
    )
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="settings",
        help="a setting of the exporter",
    )
    parser.add_argument("--list", action="store_true", help="list the formats")
    parser.set_defaults(run=deferred("opir_export.command.export"), group="data")
