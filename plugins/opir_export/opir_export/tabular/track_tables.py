"""The columns of the tables `tracks` and `regions`."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from opir_core.arrays import FloatArray
from opir_core.interfaces import IMPACT_METHODS, TRACK_CONTAINMENTS, TRACK_ENDS
from opir_core.output import geometry_of
from opir_core.plugin import REPORTED_TYPES, ImpactRegion, Tracks
from opir_export.tabular.columns import (
    TableColumn,
    instants,
    lists,
    names,
    nanoseconds,
    numbers,
    texts,
)
from opir_export.tabular.well_known_binary import well_known_binary

_UTC = "UTC"
_STATE = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
_TRIANGLE = "lower triangle by rows"


def track_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `tracks` of a run; unknown numbers are null."""
    rows: Tracks = run.tracks
    epoch_us = run.plan.scene.epoch_us
    yield TableColumn("track_id", numbers(rows.track), "", "the track")
    yield TableColumn("time_s", numbers(rows.tick_s), "s", "scene time of the estimate")
    yield TableColumn(
        "time", instants(nanoseconds(rows.tick_s), epoch_us), _UTC, "time of the estimate"
    )
    yield TableColumn(
        "available_s", numbers(rows.available_s), "s", "scene time at which it became available"
    )
    yield from _state("", rows.state, "at the time, ECEF")
    covariance = lists(_lower(rows.state_covariance))
    yield TableColumn(
        "state_covariance", covariance, "m, m/s", f"of position and velocity, ECEF: {_TRIANGLE}"
    )
    yield from _point("launch", rows.launch, rows.launch_covariance)
    yield from _state("burnout_", rows.burnout[:, :6], "at burnout, ECEF")
    yield TableColumn("burnout_s", numbers(rows.burnout[:, 6]), "s", "scene time of burnout")
    yield from _point("impact", rows.impact, rows.impact_covariance)
    yield TableColumn(
        "impact_method",
        names(rows.impact_method, IMPACT_METHODS),
        "",
        "how the impact was predicted",
    )
    sigmas = lists(rows.impact_sigmas)
    levels = ", ".join(f"{100 * level:g} %" for level in TRACK_CONTAINMENTS)
    yield TableColumn(
        "impact_sigmas", sigmas, "sigma", f"radii of the ellipses that contain the impact: {levels}"
    )
    yield from _probabilities(rows)
    yield from _hypotheses(run)
    ends = [TRACK_ENDS[code] or None for code in rows.end.tolist()]
    yield TableColumn("end", texts(ends), "", "how the track ended; null for one that goes on")


def _probabilities(rows: Tracks) -> Iterator[TableColumn]:
    """Yield the probabilities of the reported types, of a burn and of another burn."""
    for place, name in enumerate(REPORTED_TYPES):
        share = rows.type_probability[:, place]
        yield TableColumn(f"probability_{name}", numbers(share), "", "probability of the type")
    yield TableColumn(
        "probability_burning",
        numbers(rows.probability_burning),
        "",
        "probability of a burn at the time",
    )
    relights = rows.probability_relights
    yield TableColumn(
        "probability_relights",
        numbers(relights),
        "",
        "probability of no burn now and another later",
    )


def _hypotheses(run: Any) -> Iterator[TableColumn]:
    """Yield the sums over hypotheses, and the columns of each, if the tracker weighs them."""
    rows: Tracks = run.tracks
    for name, meaning in (
        ("launch", "that it was launched"),
        ("missile", "of a missile"),
        ("orbit", "of an orbit"),
    ):
        yield TableColumn(
            f"probability_{name}",
            numbers(getattr(rows, f"probability_{name}")),
            "",
            f"probability {meaning}",
        )
    if rows.hypothesis_probability.shape[1]:
        for name, share in zip(
            run.plan.hypothesis_names, rows.hypothesis_probability.T, strict=True
        ):
            yield TableColumn(
                f"hypothesis_{name.replace(' ', '_')}", numbers(share), "", f"probability of {name}"
            )


def _state(prefix: str, values: FloatArray, when: str) -> Iterator[TableColumn]:
    for place, name in enumerate(_STATE):
        unit, quantity = ("m", "position") if place < len(_STATE) // 2 else ("m/s", "velocity")
        yield TableColumn(f"{prefix}{name}", numbers(values[:, place]), unit, f"{quantity} {when}")


def _point(name: str, place: FloatArray, covariance: FloatArray) -> Iterator[TableColumn]:
    """Yield the columns of a launch or impact: latitude, longitude, time, covariance."""
    yield TableColumn(
        f"{name}_lat_deg",
        numbers(np.degrees(place[:, 0])),
        "deg",
        f"geodetic latitude of the {name}",
    )
    yield TableColumn(
        f"{name}_lon_deg", numbers(np.degrees(place[:, 1])), "deg", f"longitude of the {name}"
    )
    yield TableColumn(f"{name}_s", numbers(place[:, 2]), "s", f"scene time of the {name}")
    values = lists(_lower(covariance))
    yield TableColumn(f"{name}_covariance", values, "m, s", f"of east, north and time: {_TRIANGLE}")


def _lower(matrices: FloatArray) -> FloatArray:
    """Return the lower triangles (n, k (k + 1) / 2) of matrices (n, k, k), by rows."""
    rows, columns = np.tril_indices(matrices.shape[1])
    triangles: FloatArray = matrices[:, rows, columns]
    return triangles


def region_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `regions`: impact regions as WKB, longitude and latitude."""
    tracks: Tracks = run.tracks
    regions_of_rows = tracks.impact_regions.tolist()
    counts = np.array([len(regions) for regions in regions_of_rows], dtype=np.int64)
    row = np.repeat(np.arange(len(tracks)), counts)
    regions = [region for regions in regions_of_rows for region in regions]
    yield TableColumn("track_id", numbers(tracks.track[row]), "", "the track")
    yield TableColumn("time_s", numbers(tracks.tick_s[row]), "s", "scene time of the estimate")
    times = instants(nanoseconds(tracks.tick_s[row]), run.plan.scene.epoch_us)
    yield TableColumn("time", times, _UTC, "time of the estimate")
    yield _region_figure(
        regions, "containment", "", "probability that the region contains the impact"
    )
    yield _region_figure(regions, "area_km2", "km2", "area of the region")
    conditions = texts([region.condition for region in regions])
    yield TableColumn("condition", conditions, "", "what the region presumes")
    yield _region_figure(regions, "probability", "", "probability of the condition")
    yield _region_figure(regions, "effective_samples", "", "effective samples of the distribution")
    methods = [IMPACT_METHODS[code] for code in tracks.impact_method[row].tolist()]
    yield TableColumn("impact_method", texts(methods), "", "how the impact was predicted")
    shapes = pa.array(
        [well_known_binary(geometry_of(region)) for region in regions], type=pa.binary()
    )
    yield TableColumn("geometry", shapes, "deg", "the region, WKB of longitude and latitude")


def _region_figure(
    regions: Sequence[ImpactRegion], name: str, unit: str, meaning: str
) -> TableColumn:
    values = np.array([getattr(region, name) for region in regions], dtype=np.float64)
    return TableColumn(name, numbers(values), unit, meaning)
