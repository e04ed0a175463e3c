"""The answers of a run, a sentence per target: who saw it first, after how long, what it is, from
where, to where.

What is reported is the detections' and the tracker's; only the target's name and type are from the
truth.
"""

from collections.abc import Iterator, Mapping
from math import ceil, floor, log10
from typing import Any

from opir_core.cli.terminal import grouped, listed, probability_text

#: Targets with a sentence of their own.
_ANSWERED = 6
#: From this area on, km², no decimals are printed.
_WHOLE_KM2 = 10.0
#: What is probably a launch has a launch point and an impact.
_PROBABLE = 0.5
#: Below it the probability that a target reaches orbit, or comes down, is not printed.
_MINOR = 0.05
#: From this area on, km², that of Asia, a region says nothing of where.
_USELESS_KM2 = 4.46e7
#: Below this half-width, s, times have a decimal.
_WHOLE_S = 10.0
#: Effective samples below which a region is called thin.
_THIN = 100.0

_CONDITIONS = {"burn over": "if the burn is over: ", "relights": "relights {}: "}

Row = Mapping[str, Any]


def answers(summary: Row, most: int = _ANSWERED) -> list[str]:
    """Return a sentence for each of the first targets of a run's summary, and the number of the
    others.

    Sentences about other hot sources that the tracker takes for launches follow.
    """
    tracks = {row["track_id"]: row for row in summary["tracks"]}
    targets = summary["targets"]
    taken = [row for row in summary["sources"] if _is_taken(tracks.get(row["track_id"]))]
    return [
        *(_sentence(row, "target", _seen(row), tracks) for row in targets[:most]),
        *_others(len(targets) - most, "targets"),
        *(_sentence(row, "source", "taken for a launch", tracks) for row in taken[:most]),
        *_others(len(taken) - most, "sources taken for launches"),
    ]


def _others(count: int, nouns: str) -> list[str]:
    return [f"... and {count} more {nouns}"] if count > 0 else []


def _is_taken(track: Row | None) -> bool:
    """Return whether a source's track is probably a launch, to its tracker."""
    return (
        track is not None
        and not track["is_brief"]
        and (track["probability_launch"] or 0.0) >= _PROBABLE
    )


def _sentence(row: Row, kind: str, sighting: str, tracks: Mapping[int, Row]) -> str:
    """Return the sentence of a target or source, which begins with its `sighting`; "" for one
    that was not.
    """
    name = f"{row[f'{kind}_id']} ({row[f'{kind}_type']})"
    track = tracks.get(row["track_id"])
    if not sighting:
        return f"{name}: not detected: {says_text(row, None)}"
    return "; ".join([f"{name}: {sighting}", says_text(row, track), *_flight(track)])


def _seen(target: Row) -> str:
    latency_s = target["latency_s"]
    end_to_end_s = target["end_to_end_latency_s"]
    if latency_s is None:
        return ""
    delay = f", reported after {end_to_end_s:.3f} s" if end_to_end_s != latency_s else ""
    return f"first seen by {target['first_sensor_id']} after {latency_s:.3f} s{delay}"


def says_text(row: Row, track: Row | None) -> str:
    """Return the type of a target or source by its tracker, else by its detections, or why it was
    undetected.
    """
    likeliest = None if track is None else likeliest_text(track)
    if likeliest is not None:
        return f"tracker: {likeliest}"
    if row["reported_type"] is None:
        return str(row.get("undetected_because") or "-")
    confidence = probability_text(row["highest_confidence"])
    return (
        f"detections: {row['reported_type']}, confidence"
        f" {'' if confidence[0] in '<>' else 'up to '}{confidence}"
    )


def likeliest_text(track: Row) -> str | None:
    """Return the likeliest hypothesis of a track, `ICBM 0.97`, else its type; None without either.

    Of one that was seen too briefly to tell, that.
    """
    if track["is_brief"]:
        return f"seen within {track['seen_s']:.1f} s, too briefly to tell"
    for name, chance in (
        ("likeliest_hypothesis", "hypothesis_probability"),
        ("reported_type", "type_probability"),
    ):
        if track[name] is not None:
            return f"{track[name]} {probability_text(track[chance])}"
    return None


def _is_probable(track: Row) -> bool:
    """Return whether a track is probably a launch; without hypotheses its tracker knows launches
    alone.
    """
    chance = track["probability_launch"]
    return not track["is_brief"] and (chance is None or chance >= _PROBABLE)


def _flight(track: Row | None) -> Iterator[str]:
    """Yield whether a probable launch comes down or reaches orbit, the likelier first, and from
    where to where.
    """
    if track is None or not _is_probable(track):
        return
    falls = track["probability_comes_down"]
    orbit = track["probability_orbit"] or 0.0
    answers = ((falls or 0.0, "comes down"), (orbit, "reaches orbit"))
    # A tracker without regions does not say what comes down; of its two answers one alone would
    # mislead.
    least = _PROBABLE if falls is None else _MINOR
    yield from (
        f"{words}: {probability_text(chance)}"
        for chance, words in sorted(answers)[::-1]
        if chance >= least
    )
    law = ", the paper's law, without containment"
    points = (("from", track["launch"]), ("to", track["impact"]))
    places = [
        f"{'with' if _is_useless(point) else words} {place_text(point)}{spread_text(point, law)}"
        for words, point in points
        if point is not None
    ]
    if falls is not None and falls < _PROBABLE:
        yield from (
            place if place.startswith("from ") else f"should it come down, {place}"
            for place in places
        )
    elif places:
        yield " ".join(places)


def point_text(point: Row | None) -> str:
    """Return `34.73 N 120.57 W at 10.0 ± 2.0 s (0.1 km)`, or `-` for a point that is not estimated.

    Times have their 95 % interval. The figure is the 95 % semi-major axis, the area of the 95 %
    region, or the σ of the paper's law.
    """
    return (
        "-"
        if point is None
        else f"{place_text(point)}{_time_text(point)}{spread_text(point, most=1)}"
    )


def _time_text(point: Row) -> str:
    """Return ` at 10.0 ± 2.0 s`, the 95 % interval of a point's time; "" for one without."""
    half_s = point["time_95_s"]
    if half_s is None or _is_useless(point):
        return ""
    decimals = 1 if half_s < _WHOLE_S else 0
    return f" at {point['time_s']:.{decimals}f} ± {max(half_s, 0.1):.{decimals}f} s"


def _is_useless(point: Row) -> bool:
    """Return whether the region of a point says nothing of where."""
    return (point.get("region_95_km2") or 0.0) > _USELESS_KM2


def place_text(point: Row) -> str:
    """Return latitude and longitude, `34.73 N 120.57 W`, or between which distances from the launch
    point the impact is if its region is wide.
    """
    if _is_useless(point):
        reason = point["reason"]
        return "no useful region" if reason is None else f"no useful region, as {reason}"
    reach = point.get("from_launch")
    if reach is not None:
        return _reach_text(reach)
    lat_deg = point["lat_deg"]
    lon_deg = point["lon_deg"]
    return (
        f"{abs(lat_deg):.2f} {'N' if lat_deg >= 0.0 else 'S'} {abs(lon_deg):.2f}"
        f" {'E' if lon_deg >= 0.0 else 'W'}"
    )


def _reach_text(reach: Row) -> str:
    """Return `somewhere between 1 200 and 9 800 km away, bearing 250 to 330 deg`, rounded outwards:
    outlines of regions are as coarse as a hundredth of their size.
    """
    unit = 10 ** max(floor(log10(max(reach["most_km"], 1.0))) - 1, 0)
    least = floor(reach["least_km"] / unit) * unit
    most = ceil(reach["most_km"] / unit) * unit
    distances = f"between {grouped(least)} and" if least else "up to"
    bearings = reach["bearings_deg"]
    if bearings is None:
        return f"somewhere {distances} {grouped(most)} km away"
    first, last = 5 * floor(bearings[0] / 5.0), 5 * ceil(bearings[1] / 5.0)
    return f"somewhere {distances} {grouped(most)} km away, bearing {first} to {last} deg"


def spread_text(point: Row, law: str = "", most: int | None = None) -> str:
    """Return ` (95 % in 79 000 km2)`, ` (0.1 km)` or "": how uncertain a point is.

    A region has its condition; at most `most` are named. `law` follows the σ of the paper's law.
    """
    if point.get("sigma_km") is not None:
        return f" (sigma {point['sigma_km']:.1f} km{law})"
    if point.get("regions"):
        return f" ({'; '.join(map(_region_text, point['regions'][:most]))})"
    return "" if point["semi_major_95_km"] is None else f" ({point['semi_major_95_km']:.1f} km)"


def _region_text(region: Row) -> str:
    """Return `95 % in 79 000 km2`, after what the region presumes."""
    short = float(f"{region['area_95_km2']:.2g}")
    samples = region["effective_samples"]
    area = grouped(round(short)) if short >= _WHOLE_KM2 else f"{short:g}"
    presumed = _CONDITIONS.get(region["condition"], "").format(
        probability_text(region["probability"])
    )
    return (
        f"{presumed}95 % in {area} km2{', thin' if samples is not None and samples < _THIN else ''}"
    )


_SOURCE_HEAD = ("source", "type", "first detected by", "detections", "track", "reported")
_WHERE = (
    "from s",
    "to s",
    "seen s",
    "launch point (95 % semi-major axis)",
    "predicted impact point",
)
_NUMBERS = {"detections", "track", "from s", "to s", "seen s"}

#: The head of a table and the cells of its rows.
Table = tuple[tuple[str, ...], list[tuple[str, ...]]]


def reported_tables(summary: Row) -> Iterator[str]:
    """Yield the tables of hot sources other than targets, and of tracks, as text."""
    for head, rows in (source_table(summary), track_table(summary)):
        yield listed(
            head, rows, numbers=[place for place, name in enumerate(head) if name in _NUMBERS]
        )
    if any(
        row["impact"] is not None and row["impact"]["method"] == "paper"
        for row in summary["tracks"]
    ):
        yield "sigma of an impact: the paper's law, without containment"


def source_table(summary: Row) -> Table:
    """Return the table of hot sources other than targets, those taken for launches first."""
    tracks = {row["track_id"]: row for row in summary["tracks"]}
    rows = sorted(summary["sources"], key=lambda row: not _is_taken(tracks.get(row["track_id"])))
    return _SOURCE_HEAD, [source_cells(row, tracks) for row in rows]


def track_table(summary: Row) -> Table:
    """Return the table of tracks, probable launches first, with hypotheses if any track has
    them.
    """
    weighs = any(row["hypotheses"] is not None for row in summary["tracks"])
    head = (
        ("track", "likeliest", "P(launch)", *_WHERE, "end")
        if weighs
        else ("track", "type", *_WHERE)
    )
    rows = sorted(summary["tracks"], key=lambda row: not _is_probable(row))
    return head, [track_cells(row, weighs=weighs) for row in rows]


def track_cells(row: Row, *, weighs: bool) -> tuple[str, ...]:
    """Return the cells of a track; `weighs` for a tracker that weighs hypotheses.

    Only a probable launch has a launch point and an impact.
    """
    launch, impact = (row["launch"], row["impact"]) if _is_probable(row) else (None, None)
    times = tuple(
        "-" if row[name] is None else f"{row[name]:.1f}" for name in ("first_s", "last_s", "seen_s")
    )
    head = (str(row["track_id"]), likeliest_text(row) or "-")
    where = (*times, point_text(launch), point_text(impact))
    if not weighs:
        return (*head, *where)
    chance = None if row["is_brief"] else row["probability_launch"]
    return (*head, "-" if chance is None else probability_text(chance), *where, row["end"] or "-")


def source_cells(row: Row, tracks: Mapping[int, Row]) -> tuple[str, ...]:
    """Return the cells of a hot source other than a target."""
    track = tracks.get(row["track_id"])
    first_sensor = row["first_sensor_id"] or "not detected"
    named = row["source_id"], row["source_type"], first_sensor, grouped(row["detections"])
    return (*named, "-" if track is None else str(row["track_id"]), says_text(row, track))


def reported_cells(summary: Row) -> list[str]:
    """Return each target's type by its tracker or its detections, or why it was not detected."""
    tracks = {row["track_id"]: row for row in summary["tracks"]}
    return [says_text(row, tracks.get(row["track_id"])) for row in summary["targets"]]
