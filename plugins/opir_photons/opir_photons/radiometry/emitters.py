"""Emitters as columns: from a list, from a CSV file, or drawn at random over a region."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from io import StringIO

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, WordArray
from opir_core.errors import ModelError, Problem, SceneError
from opir_core.plugin import SourceContext
from opir_core.random_streams import Stream, normal_pairs, stream_key, uniforms_of
from opir_core.scene import file_bytes, text_of
from opir_photons.radiometry.source_configs import (
    PLACE_FIELDS,
    FieldConfig,
    PlacedConfig,
    PlacesConfig,
    emitter_complaint,
    names_complaint,
    own_fields,
)

#: The largest number of emitters of one block.
MOST_EMITTERS = 20_000

Emitter = Mapping[str, float]


@frozen(eq=False)
class Emitters:
    """Position, time and brightness of emitters: columns (n,) by the names of scenes."""

    columns: Mapping[str, FloatArray]

    def __len__(self) -> int:
        return len(self.columns["lat_deg"])

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]


def emitters_of(
    config: PlacedConfig, context: SourceContext, *, is_brief: bool = False
) -> Emitters:
    """Return the emitters of a block, with the values of the block where they have none of their
    own.

    Brief ones of a random field begin at random during the scene. `SceneError`, with its line, for
    an invalid file, `ModelError` for more emitters than a block may have.
    """
    settings = {name: getattr(config, name) for name in own_fields(type(config))}
    defaults = {name: np.nan if value is None else value for name, value in settings.items()}
    if settings["end_s"] is None:
        defaults["end_s"] = context.duration_s + 10.0
    field: PlacesConfig | None = getattr(config, "field", None)
    if field is not None:
        drawn = _drawn(field, defaults, context, is_brief)
        count = len(drawn["lat_deg"])
        columns = {name: np.full(count, value) for name, value in defaults.items()}
        return Emitters({**columns, **drawn})
    rows = rows_of_csv(str(config.csv), config, context.path) if config.at is None else config.at
    if len(rows) > MOST_EMITTERS:
        raise ModelError(
            f"{context.path}: {len(rows)} emitters; a block has at most {MOST_EMITTERS}"
        )
    return Emitters(
        {
            name: np.array([row.get(name, defaults.get(name)) for row in rows], dtype=np.float64)
            for name in (*PLACE_FIELDS, *defaults)
        }
    )


def rows_of_csv(path: str, block: PlacedConfig, scene_path: str) -> Sequence[Emitter]:
    """Return the emitters of a CSV file; raises `SceneError` with one message that names file and
    line.
    """

    def refusal(message: str) -> SceneError:
        return SceneError([Problem(f"{scene_path}.csv", message)])

    if not path:
        raise refusal("the path is empty; give that of a file of emitters")
    try:
        text = text_of(file_bytes(path))
        return [_emitter(row, number, block) for number, row in _numbered(text, type(block))]
    except (OSError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise refusal(f"{path} cannot be read: {reason}") from error
    except ValueError as error:
        raise refusal(f"{path}, {error}") from error


def _numbered(text: str, kind: type) -> Sequence[tuple[int, Mapping[str, str]]]:
    """Return the lines of a CSV with their numbers, without empty ones and comments (#).

    Semicolons or tabs may part the columns; decimals may have commas then.
    """
    lines = _stripped(text)
    number, header = next(lines, (1, []))
    if not header:
        raise ValueError("line 1: a header with lat_deg and lon_deg is needed")
    complaint = _header_complaint(header, kind)
    if complaint:
        raise ValueError(f"line {number}: {complaint}")
    rows = []
    for number, cells in lines:
        if len(cells) != len(header):
            raise ValueError(f"line {number}: {len(cells)} cells under a header of {len(header)}")
        rows.append((number, dict(zip(header, cells, strict=True))))
    return rows


def _stripped(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the numbers and cells of the lines of a CSV that are neither empty nor comments."""
    lines = (line for line in text.splitlines() if line.strip())
    head = next((line for line in lines if not line.lstrip().startswith("#")), "")
    delimiter = next((mark for mark in "\t;" if mark in head), ",")
    reader = csv.reader(StringIO(text), delimiter=delimiter, strict=True)
    for row in reader:
        cells = [cell.strip() for cell in row]
        if any(cells) and not cells[0].startswith("#"):
            if delimiter != ",":
                cells = [cell.replace(",", ".") for cell in cells]
            yield reader.line_num, cells


def _header_complaint(header: list[str], kind: type) -> str | None:
    named = [name for name in header if name]
    if len(set(named)) < len(named):
        return "a name stands twice in the header"
    complaint = names_complaint(named, kind)
    if complaint and len(header) == 1 and " " in header[0]:
        return "the header is one cell; commas, semicolons or tabs separate cells"
    return complaint and f"in the header {complaint}"


def _emitter(row: Mapping[str, str], number: int, block: PlacedConfig) -> Emitter:
    emitter = {}
    for name, text in row.items():
        try:
            if text:
                emitter[name] = _number(text)
        except ValueError:
            raise ValueError(f"line {number}: {name}: {text!r} is not a number") from None
    complaint = emitter_complaint(emitter, block)
    if complaint:
        raise ValueError(f"line {number}: {complaint}")
    return emitter


def _number(text: str) -> float:
    """Return the number of a cell; Python's underscores are invalid."""
    if "_" in text:
        raise ValueError
    return float(text)


def _drawn(
    field: PlacesConfig, defaults: Mapping[str, float], context: SourceContext, is_brief: bool
) -> dict[str, FloatArray]:
    """Return positions, areas of what has one and, for brief emitters, start times of a random
    field.
    """
    region = field.region
    south, north = np.sin(np.radians([region.south_deg, region.north_deg]))
    hours = context.duration_s / 3600.0 if is_brief else 1.0
    count = _poisson(field.per_million_km2 * region.surface_m2 * 1e-12 * hours, context)
    sine = south + uniforms(context, "latitude", count) * (north - south)
    longitude_deg = region.west_deg + uniforms(context, "longitude", count) * region.width_deg
    drawn = {
        "lat_deg": np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))),
        "lon_deg": (longitude_deg + 180.0) % 360.0 - 180.0,
    }
    if isinstance(field, FieldConfig):
        size = normals(context, "area", count)
        drawn["area_m2"] = defaults["area_m2"] * np.exp(field.area_log_sigma * size)
    if is_brief:
        drawn["start_s"] = uniforms(context, "start", count) * context.duration_s
    return drawn


def _poisson(mean: float, context: SourceContext) -> int:
    """Return a Poisson-distributed number: the count of exponential intervals below the mean."""
    if mean > MOST_EMITTERS:
        raise ModelError(
            f"{context.path}: {mean:g} emitters are expected; a block has at most {MOST_EMITTERS}:"
            " lower per_million_km2 or take a smaller region"
        )
    # Ten standard deviations above the mean: beyond once in 1e23 runs.
    limit = int(mean + 10.0 * np.sqrt(mean) + 40.0)
    steps = -np.log1p(-uniforms(context, "count", limit))
    return int(np.count_nonzero(np.cumsum(steps) < mean))


def uniforms(context: SourceContext, purpose: str, count: int) -> FloatArray:
    """Return numbers (count,) even in [0, 1) of a block's stream for a purpose."""
    return uniforms_of(_words(context, purpose, count))


def normals(context: SourceContext, purpose: str, count: int) -> FloatArray:
    """Return standard normal numbers (count,) of a block's stream for a purpose."""
    return normal_pairs(_words(context, purpose, count))[0]


def _words(context: SourceContext, purpose: str, count: int) -> WordArray:
    return Stream(stream_key(context.seed, "source", context.id, purpose)).words(0, count)
