"""When the sensors of foreign detections looked: where no sensor looked, a missing detection is no
miss.

The spans are those of a table, else of the scene, else of heartbeats among the events, else of the
manifest of the run that wrote the events, else from the first to the last line of each sensor,
without the gaps between its lines.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core import Scene
from opir_core.arrays import IntArray
from opir_core.errors import BAD_DATA, nearest_names
from opir_core.plugin import BadFileError
from opir_core.reading import epoch_us_of_text
from opir_readers.csv_layout import Layout, table_layout
from opir_readers.detections.heartbeats import (
    Spans,
    contradictions,
    heartbeat_spans,
    with_detections,
)
from opir_readers.detections.numbers import Rows, finite
from opir_readers.detections.times import NS_PER_S, looks_like_date, unix_ns
from opir_readers.reading import file_text, refused

#: The value of `--watched` for sensors that looked throughout the scene.
THROUGHOUT = "throughout"

#: What gives the spans of a sensor that nothing else does.
_BY_LINES = "first and last lines, and gaps"

#: A gap is one without looks if misses make one as long in fewer files than this share; at least
#: this share of looks may miss.
GAP_PROBABILITY = 1e-3
MIN_MISS_PROBABILITY = 0.05

#: The fewest lines of a sensor whose gaps are looked at.
_MIN_LINES = 8

_SENSOR = ("sensor_id", "sensor")
_START = ("start_s", "start", "from")
_END = ("end_s", "end", "to")


@frozen
class Watched:
    """The spans, s, in which each sensor looked, and what gives them, in words, by its id.

    `doubts` are sentences on detections that contradict them.
    """

    spans: Mapping[str, Spans]
    source: Mapping[str, str]
    doubts: tuple[str, ...] = ()

    @property
    def end_s(self) -> float:
        """Return when the last sensor looked last, 0 where none did."""
        return max((spans[-1][1] for spans in self.spans.values() if spans), default=0.0)


def watched_of(
    arguments: argparse.Namespace,
    rows: Rows,
    sensors: Sequence[str],
    time_ns: IntArray,
    scene: Scene,
    renamed: Mapping[str, str],
) -> Watched:
    """Return when the sensors of a scene looked, by detections of `sensors` (n,) at scene times
    (n,); `renamed` are other names of sensors.

    Raises `SceneError` for a table of spans that cannot be taken, `BadFileError` for heartbeats.
    """
    names = np.array(sensors)
    times_ns = {sensor.id: time_ns[names == sensor.id] for sensor in scene.sensors}
    by_lines = {
        sensor.id: _spans_of_lines(times_ns[sensor.id], _period_ns(sensor.model.config))
        for sensor in scene.sensors
    }
    beats = heartbeat_spans(rows, list(times_ns), renamed, scene.epoch_us)
    if beats and arguments.watched is None and not scene.watched_s:
        return _by_heartbeats(beats, times_ns, by_lines)
    spans, source = _stated(arguments, len(rows), scene)
    sources = {**dict.fromkeys(by_lines, _BY_LINES), **dict.fromkeys(spans, source)}
    return Watched({**by_lines, **spans}, sources)


def _by_heartbeats(
    beats: Mapping[str, Spans], times_ns: Mapping[str, IntArray], by_lines: Mapping[str, Spans]
) -> Watched:
    """Return the spans of heartbeats, with what was detected outside of them; a sensor without one
    is known by its lines.
    """
    spans = dict(by_lines)
    doubts = list[str]()
    for name, of_sensor in beats.items():
        joined, outside_s = with_detections(of_sensor, times_ns[name] / NS_PER_S)
        spans[name] = _from_start(joined)
        doubts += contradictions(name, outside_s)
    source = {**dict.fromkeys(by_lines, _BY_LINES), **dict.fromkeys(beats, "its heartbeats")}
    return Watched(spans, source, tuple(doubts))


def _stated(
    arguments: argparse.Namespace, count: int, scene: Scene
) -> tuple[Mapping[str, Spans], str]:
    """Return the spans that a table, the scene or a manifest gives, and which of them, for a file
    of `count` detections.
    """
    ids = [sensor.id for sensor in scene.sensors]
    throughout = dict.fromkeys(ids, ((0.0, scene.duration_s),))
    if arguments.watched == THROUGHOUT:
        return throughout, "--watched throughout"
    if arguments.watched is not None:
        try:
            spans = _spans_of_table(file_text(arguments.watched).text, ids, scene.epoch_us)
        except BadFileError as error:
            raise refused(arguments.watched, error) from error
        return spans, arguments.watched
    if scene.watched_s:
        return {**throughout, **scene.watched_s}, "the scene"
    spans = _spans_of_manifest(Path(arguments.file), count, ids, scene.epoch_us)
    return spans, "the manifest beside the events"


def _period_ns(config: Any) -> float:
    """Return the scan period of a sensor's settings, ns, 0 where they have none."""
    return 1e6 * float(getattr(config, "scan_period_ms", 0.0))


def _spans_of_lines(time_ns: IntArray, period_ns: float) -> Spans:
    """Return the spans from the first to the last of a sensor's lines, parted by gaps."""
    times_ns = np.unique(time_ns)
    if not len(times_ns):
        return ()
    gaps_ns = np.diff(times_ns)
    is_long = np.zeros(len(gaps_ns), dtype=np.bool_)
    if len(times_ns) >= _MIN_LINES:
        is_long = gaps_ns > _longest_gap_ns(gaps_ns, period_ns)
    starts = times_ns[np.append(True, is_long)] / NS_PER_S
    ends = times_ns[np.append(is_long, True)] / NS_PER_S
    # A look lasts no time; the span of a line alone is long enough to be one.
    return tuple(zip(starts.tolist(), np.maximum(ends, starts + 1e-6).tolist(), strict=True))


def _longest_gap_ns(gaps_ns: IntArray, period_ns: float) -> float:
    """Return the longest gap between lines that looks which miss explain, ns.

    Of n looks that detect with probability p, any k in a row all miss with a probability below
    n (1 - p)^k. The time between looks and p follow from the gaps themselves, the rare ones left
    out.
    """
    between_ns = max(float(np.percentile(gaps_ns, 5.0)), period_ns)
    usual_ns = float(gaps_ns[gaps_ns <= np.percentile(gaps_ns, 95.0)].mean())
    miss = max(1.0 - between_ns / max(usual_ns, between_ns), MIN_MISS_PROBABILITY)
    return between_ns * (1.0 + float(np.log(len(gaps_ns) / GAP_PROBABILITY) / -np.log(miss)))


def _spans_of_table(text: str, ids: Sequence[str], epoch_us: int) -> dict[str, Spans]:
    """Return the spans of a table of sensors, starts and ends; raises `BadFileError` with the line
    of a wrong one.
    """
    text, layout = table_layout(text, ())
    places = [_place(layout, names) for names in (_SENSOR, _START, _END)]
    spans = dict[str, Spans]()
    for line, cells in layout.rows(text):
        layout.require_width(cells, line)
        name, start, end = (cells[place].strip() for place in places)
        _require_sensor(name, ids, line)
        start_s = _time_s(start, layout, line, "start", epoch_us)
        end_s = _time_s(end, layout, line, "end", epoch_us)
        earlier = spans.get(name, ())
        if not start_s < end_s:
            raise BadFileError(f"line {line}: its end, {end}, is not after its start, {start}")
        if earlier and start_s < earlier[-1][1]:
            raise BadFileError(
                f"line {line}: its start, {start}, is before the end of the span of {name} above it;"
                " give spans in order, without overlap"
            )
        spans[name] = (*earlier, (start_s, end_s))
    if not spans:
        raise BadFileError("has no span below the names of its columns")
    return {name: _from_start(of_sensor) for name, of_sensor in spans.items()}


def _require_sensor(name: str, ids: Sequence[str], line: int) -> None:
    if name not in ids:
        nearest = nearest_names(name, ids)
        hint = f"did you mean {nearest[0]}?" if nearest else f"there are {', '.join(ids[:12])}"
        raise BadFileError(f"line {line}: {name!r} is no sensor of --sensors; {hint}")


def _from_start(spans: Spans) -> Spans:
    """Return spans without what is before the scene."""
    return tuple((max(start_s, 0.0), end_s) for start_s, end_s in spans if end_s > 0.0)


def _place(layout: Layout, names: Sequence[str]) -> int:
    lower = [name.strip().lower() for name in layout.names]
    places = [lower.index(name) for name in names if name in lower]
    if not places:
        raise BadFileError(
            f"line {layout.line}: lacks {names[0]}; a line has sensor_id, start_s and end_s, in"
            " seconds of the scene or as dates"
        )
    return places[0]


def _time_s(cell: str, layout: Layout, line: int, edge: str, epoch_us: int) -> float:
    """Return the scene time of a cell, seconds or a date."""
    if looks_like_date(cell):
        return (unix_ns(cell, f"line {line}: {edge}") - 1000 * epoch_us) / NS_PER_S
    try:
        value: Any = layout.number(cell)
    except ValueError:
        value = cell
    return finite(value, f"line {line}: {edge}")


def _spans_of_manifest(
    events: Path, count: int, ids: Sequence[str], epoch_us: int
) -> dict[str, Spans]:
    """Return the spans of the manifest of a run beside its events, none where there is none, or it
    is of other events.
    """
    try:
        manifest = json.loads(events.with_suffix(".manifest.json").read_text(encoding="utf-8"))
        later_s = (epoch_us_of_text(manifest["scene"]["epoch"]) - epoch_us) * 1e-6
        if manifest["counts"]["detections"] != count or not _wrote(manifest, events.name):
            return {}
        return {
            name: _from_start(tuple((start + later_s, end + later_s) for start, end in spans))
            for name, spans in manifest["watched_s"].items()
            if name in ids
        }
    except (OSError, *BAD_DATA):
        return {}


def _wrote(manifest: Mapping[str, Any], name: str) -> bool:
    """Return whether a run wrote a file of a name, by its manifest."""
    outputs = manifest["scene"]["outputs"]
    paths = [settings.get("path") for output in outputs for settings in output.values()]
    return name in [Path(str(path)).name for path in paths]


def watched_lines(watched: Watched, most: int = 4) -> Iterator[str]:
    """Yield sentences on when the sensors looked, of `most` sensors; the table has all."""
    looking = [(name, spans) for name, spans in watched.spans.items() if spans]
    for name, spans in looking[:most]:
        edges = [*["before"] * (spans[0][0] > 0.0), *["between"] * (len(spans) > 1)]
        when = f"{', '.join(edges)} and after that" if edges else "after that"
        yield (
            f"{name} watched {spans_text(spans)} s; {when} nothing is known"
            f" (by {watched.source[name]})"
        )


def spans_text(spans: Spans, most: int = 4) -> str:
    """Return spans in words, the first and the last of many.

    >>> spans_text(((10.0, 50.0), (65.0, 140.04)))
    '10.0–50.0 and 65.0–140.0'
    """
    texts = [f"{start_s:.1f}–{end_s:.1f}" for start_s, end_s in spans]
    if len(texts) > most:
        return f"{texts[0]}, … and {texts[-1]} ({len(texts)} spans)"
    return " and ".join(texts) or "never"
