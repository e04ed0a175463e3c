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
    texts,
)
from opir_export.tabular.well_known_binary import well_known_binary

_STATE = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
_TRIANGLE = "lower triangle by rows"


def track_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `tracks` of a run; unknown numbers are null."""
    rows: Tracks = run.tracks
    epoch_us = run.plan.scene.epoch_us
    yield TableColumn("track_id", rows.track, "the track")
    yield TableColumn("time_s", rows.tick_s, "scene time of the estimate")
    yield TableColumn("time", instants(nanoseconds(rows.tick_s), epoch_us), "time of the estimate")
    yield TableColumn("available_s", rows.available_s, "scene time at which it became available")
    yield from _state("", rows.state, "at the time, ECEF")
    covariance = lists(_lower(rows.state_covariance))
    yield TableColumn(
        "state_covariance",
        covariance,
        f"of position and velocity, ECEF: {_TRIANGLE}",
        unit="m, m/s",
    )
    yield from _point("launch", rows.launch, rows.launch_covariance)
    yield from _state("burnout_", rows.burnout[:, :6], "at burnout, ECEF")
    yield TableColumn("burnout_s", rows.burnout[:, 6], "scene time of burnout")
    yield from _point("impact", rows.impact, rows.impact_covariance)
    yield TableColumn(
        "impact_method", names(rows.impact_method, IMPACT_METHODS), "how the impact was predicted"
    )
    sigmas = lists(rows.impact_sigmas)
    levels = ", ".join(f"{100 * level:g} %" for level in TRACK_CONTAINMENTS)
    yield TableColumn(
        "impact_sigmas",
        sigmas,
        f"radii of the ellipses that contain the impact: {levels}",
        unit="sigma",
    )
    yield from _probabilities(rows)
    yield from _hypotheses(run)
    ends = [TRACK_ENDS[code] or None for code in rows.end.tolist()]
    yield TableColumn("end", texts(ends), "how the track ended; null for one that goes on")


def _probabilities(rows: Tracks) -> Iterator[TableColumn]:
    """Yield the probabilities of the reported types, of a burn and of another burn."""
    for place, name in enumerate(REPORTED_TYPES):
        share = rows.type_probability[:, place]
        yield TableColumn(f"probability_{name}", share, "probability of the type")
    yield TableColumn(
        "probability_burning", rows.probability_burning, "probability of a burn at the time"
    )
    relights = rows.probability_relights
    yield TableColumn(
        "probability_relights", relights, "probability of no burn now and another later"
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
            f"probability_{name}", getattr(rows, f"probability_{name}"), f"probability {meaning}"
        )
    if rows.hypothesis_probability.shape[1]:
        shares = zip(run.plan.hypothesis_names, rows.hypothesis_probability.T, strict=True)
        for name, share in shares:
            column = f"hypothesis_{name.replace(' ', '_')}"
            yield TableColumn(column, share, f"probability of {name}", unit="")


def _state(prefix: str, values: FloatArray, when: str) -> Iterator[TableColumn]:
    for place, name in enumerate(_STATE):
        quantity = "position" if place < len(_STATE) // 2 else "velocity"
        yield TableColumn(f"{prefix}{name}", values[:, place], f"{quantity} {when}")


def _point(name: str, place: FloatArray, covariance: FloatArray) -> Iterator[TableColumn]:
    """Yield the columns of a launch or impact: latitude, longitude, time, covariance."""
    yield TableColumn(
        f"{name}_lat_deg", np.degrees(place[:, 0]), f"geodetic latitude of the {name}"
    )
    yield TableColumn(f"{name}_lon_deg", np.degrees(place[:, 1]), f"longitude of the {name}")
    yield TableColumn(f"{name}_s", place[:, 2], f"scene time of the {name}")
    values = lists(_lower(covariance))
    yield TableColumn(
        f"{name}_covariance", values, f"of east, north and time: {_TRIANGLE}", unit="m, s"
    )


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
    yield TableColumn("track_id", tracks.track[row], "the track")
    yield TableColumn("time_s", tracks.tick_s[row], "scene time of the estimate")
    times = instants(nanoseconds(tracks.tick_s[row]), run.plan.scene.epoch_us)
    yield TableColumn("time", times, "time of the estimate")
    yield _region_figure(regions, "containment", "probability that the region contains the impact")
    yield _region_figure(regions, "area_km2", "area of the region")
    conditions = texts([region.condition for region in regions])
    yield TableColumn("condition", conditions, "what the region presumes")
    yield _region_figure(regions, "probability", "probability of the condition")
    yield _region_figure(regions, "effective_samples", "effective samples of the distribution")
    methods = [IMPACT_METHODS[code] for code in tracks.impact_method[row].tolist()]
    yield TableColumn("impact_method", texts(methods), "how the impact was predicted")
    shapes = pa.array(
        [well_known_binary(geometry_of(region)) for region in regions], type=pa.binary()
    )
    yield TableColumn("geometry", shapes, "the region, WKB of longitude and latitude", unit="deg")


def _region_figure(regions: Sequence[ImpactRegion], name: str, meaning: str) -> TableColumn:
    values = np.array([getattr(region, name) for region in regions], dtype=np.float64)
    return TableColumn(name, values, meaning)
