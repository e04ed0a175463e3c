"""The settings of the exporters; no heavy imports."""

from attrs import frozen

from opir_core.plugin import REPORTED_TYPES, flag, nested, number, text

#: The names of the tables of a run.
TABLES = ("detections", "truth", "tracks", "regions", "targets", "sensors")
ALL = "all"

#: Separators of CSV columns, by name.
DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t"}


def _tables_complaint(value: str) -> str | None:
    unknown = [name for name in named_tables(value) if name not in TABLES]
    return f"no table is named {unknown[0]!r}; there are {', '.join(TABLES)}" if unknown else None


def named_tables(value: str) -> tuple[str, ...]:
    """Return the names of a setting `tables`; `all` gives `TABLES`."""
    return TABLES if value.strip() == ALL else tuple(name.strip() for name in value.split(","))


def _step_s(default: float, words: str) -> float:
    return number(default=default, unit="s", minimum=0.1, maximum=3600.0, help=words)


def _parquet_compression() -> str:
    codecs = ("zstd", "snappy", "gzip", "none")
    return text(default="zstd", choices=codecs, help="compression of the column chunks")


def _tables_setting() -> str:
    words = "tables to write, with commas between, or all"
    return nested(default=ALL, check=_tables_complaint, help=words)


@frozen
class ParquetConfig:
    """One Parquet file for each table."""

    tables: str = _tables_setting()
    compression: str = _parquet_compression()


@frozen
class ArrowConfig:
    """One Arrow IPC file (Feather version 2) for each table."""

    tables: str = _tables_setting()
    compression: str = text(
        default="zstd", choices=("zstd", "lz4", "none"), help="compression of the record batches"
    )


@frozen
class CsvConfig:
    """One CSV file for each table, with a line of names."""

    tables: str = _tables_setting()
    delimiter: str = text(
        default="comma", choices=tuple(DELIMITERS), help="what separates the columns"
    )


@frozen
class OemConfig:
    """States of the sensors and of the true flights."""

    objects: str = text(
        default="all",
        choices=("all", "targets", "sensors"),
        help="objects whose states are written",
    )
    step_s: float = _step_s(10.0, "time between two states")
    burn_step_s: float = _step_s(1.0, "time between two states of a burn")
    frame: str = text(
        default="ITRF2000",
        choices=("ITRF2000", "ITRF-97", "ITRF-93", "ITRF"),
        help="name of the Earth-fixed frame",
    )


@frozen
class TdmConfig:
    """Measured angles of each sensor."""

    angles: str = text(
        default="azel",
        choices=("azel", "radec"),
        help="azimuth and elevation at the sensor, or right ascension and declination in EME2000",
    )
    objects: str = text(
        default="tracks",
        choices=("tracks", "targets"),
        help="what detections are sorted by: tracks, or true targets",
    )


@frozen
class SceneConfig:
    """The scene of a run; of a live run that of one lap."""

    lap: int = number(
        default=0, minimum=0, maximum=1_000_000, help="lap of a live run that repeats its scene"
    )


@frozen
class CuesConfig:
    """Site of the sensor that searches, and the estimate of each track that it is sent."""

    lat_deg: float = number(
        unit="deg", minimum=-90.0, maximum=90.0, source="", help="geodetic latitude of the site"
    )
    lon_deg: float = number(
        unit="deg", minimum=-180.0, maximum=360.0, source="", help="east longitude of the site"
    )
    height_m: float = number(
        default=0.0,
        unit="m",
        minimum=-500.0,
        maximum=50_000.0,
        source="0: on the ellipsoid",
        help="height of the site above the ellipsoid",
    )
    mask_deg: float = number(
        default=5.0, unit="deg", minimum=-10.0, below=90.0, help="least elevation that it sees"
    )
    at: str = text(
        default="burnout",
        choices=("first", "burnout", "launch", *REPORTED_TYPES),
        help=(
            "estimate that is sent: the first, the first without a burn, or the first in which a"
            " launch or a type has `probability`"
        ),
    )
    probability: float = number(
        default=0.9, above=0.0, below=1.0, help="probability of a launch or a type that is exceeded"
    )
    horizon_s: float | None = number(
        default=None,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        source="choice",
        help="time from the estimate to the volume; none: when the target first is above the mask",
    )


@frozen
class MapConfig:
    """Contents of a map: steps of paths, predicted regions, footprints."""

    step_s: float = _step_s(10.0, "time between two points of a path")
    regions: str = text(
        default="last",
        choices=("last", "all", "none"),
        help="predicted impacts of each track: the last, all with their times, or none",
    )
    footprints: bool = flag(
        default=True, help="the ground that each sensor can see at the scene's start"
    )


@frozen
class CzmlConfig(MapConfig):
    """Contents of a map over time, with the volumes that a sensor must search for its tracks."""

    search_volumes: bool = flag(
        default=False,
        help="the ellipsoid that holds each target with 95 %, in free flight from the first estimate"
        " without a burn, until it comes down",
    )


@frozen
class ParquetSinkConfig:
    """The settings of the sink `parquet`."""

    path: str = text(default="events.parquet", help="file in an existing folder, overwritten")
    compression: str = _parquet_compression()
    row_group_rows: int = number(
        default=65_536,
        minimum=1,
        maximum=10_000_000,
        help="detections of a row group; the last has the rest",
    )
