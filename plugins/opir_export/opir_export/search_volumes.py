"""The volumes that a sensor on the ground must search for the targets of a run's tracks.

A track that no longer burns is carried on in free flight, under the gravity of its scene, from one
of its estimates to the time at which it rises above the site's mask. Its covariance goes with it,
by the differences of free flights from one standard deviation to both sides of the state (12
flights), and is taken as normal there.
"""

from collections.abc import Iterator
from statistics import NormalDist
from typing import Any, NamedTuple

import msgspec
import numpy as np

from opir_core.arrays import FloatArray, IntArray, ObjectArray
from opir_core.errors import Problem, SceneError
from opir_core.estimation import CONTAINMENT, containment_ellipse
from opir_core.flight import Forces, free_flight_ephemeris, impact, propagate
from opir_core.geometry import (
    AzimuthElevationRange,
    azimuth_elevation_range_in_axes,
    ecef_to_eci_state,
    eci_to_ecef,
    elevation_rad,
    geodetic_to_ecef,
    local_axes,
    zero_crossings,
)
from opir_core.plugin import REPORTED_TYPES, Tracks
from opir_export.scenery.map_features import LONGEST_FLIGHT_S, timestamps
from opir_export.settings import CuesConfig

#: The name of the tracker of a scene without one.
NO_TRACKER = "none"
#: A target burns no longer if the probability of a burn is below this.
BURNING = 0.05
#: Radius of the ellipsoid that holds 95 % of a normal distribution in space, standard deviations:
#: the root of the chi-square quantile of three degrees of freedom.
ELLIPSOID_SIGMAS = 2.79548
#: Half the width of the interval that holds 95 % of one number, standard deviations.
_INTERVAL_SIGMAS = NormalDist().inv_cdf(0.5 + 0.5 * CONTAINMENT)
#: Step of the search for the rise, s.
_STEP_S = 10.0


class Volume(msgspec.Struct, frozen=True):
    """The volume in which a target is at one time, with 95 %, from a site.

    `covariance_m2` is over east, north and up at the site, m². Each of the three intervals
    `*_95_*`, to both sides, holds its own number with 95 %; the ellipse on the sky, of area
    `solid_angle_sr`, holds the direction, and the ellipsoid, of `ellipsoid_m3`, the place.
    """

    time_s: float
    time: str
    react_s: float
    azimuth_deg: float
    elevation_deg: float
    range_m: float
    azimuth_sigma_deg: float
    elevation_sigma_deg: float
    range_sigma_m: float
    azimuth_95_deg: float
    elevation_95_deg: float
    range_95_m: float
    semi_major_deg: float
    semi_minor_deg: float
    orientation_deg: float
    solid_angle_sr: float
    range_depth_m: float
    ellipsoid_m3: float
    position_ecef_m: list[float]
    covariance_m2: list[list[float]]


class TrackCue(msgspec.Struct, frozen=True):
    """A track, its estimate at the event, and the volume to search; None, with the reason, without
    one.
    """

    track_id: int
    reason: str
    event_s: float | None
    available_s: float | None
    probability_launch: float | None
    probability_burning: float | None
    probability_relights: float | None
    volume: Volume | None


def search_volumes(run: Any, **settings: Any) -> list[TrackCue]:
    """Return a cue for each track of a run, in the order of their numbers.

    `settings` are those of the exporter `cues`. Raises `SceneError` for a run without a tracker,
    `ValueError` for a setting out of its range.
    """
    return cues_of(run, CuesConfig(**settings))


def cues_of(run: Any, config: CuesConfig) -> list[TrackCue]:
    """Return the cues of a run for settings; as `search_volumes`."""
    tracks: Tracks = run.tracks
    scene = run.plan.scene
    if not len(tracks) and scene.tracker.name == NO_TRACKER:
        words = "has no tracks: run it with a tracker, as in `opir run SCENE --tracker imm`"
        raise SceneError([Problem("", words)], source=f"the run of {scene.name}")
    numbers = np.unique(tracks.track)
    rows = _event_rows(tracks, numbers, config)
    reasons = _reasons(tracks, rows)
    flying = np.flatnonzero(reasons == "")
    estimates = tracks.take(rows[flying])
    forces = Forces(zonal=scene.forces.zonal)
    time_s, reasons[flying] = _times(estimates, forces, config)
    seen = np.flatnonzero(np.isfinite(time_s))
    places = _places(estimates.take(seen), time_s[seen], forces)
    volumes = dict(zip(flying[seen].tolist(), _volumes(run, places, config), strict=True))
    columns = zip(numbers.tolist(), rows.tolist(), reasons.tolist(), strict=True)
    return [
        TrackCue(track, reason, **_estimate(tracks, row), volume=volumes.get(place))
        for place, (track, row, reason) in enumerate(columns)
    ]


class FlownVolume(NamedTuple):
    """The search volume of a track over time: ECEF positions (n, 3), m, and their covariances
    (n, 3, 3), m², at scene times (n,), s.
    """

    track: int
    time_s: FloatArray
    position_m: FloatArray
    covariance_m2: FloatArray


def flown_volumes(run: Any, step_s: float) -> Iterator[FlownVolume]:
    """Yield the search volume of each track at steps from when its first estimate without a burn is
    available, until it comes down; of those that have such an estimate.
    """
    tracks: Tracks = run.tracks
    forces = Forces(zonal=run.plan.scene.forces.zonal)
    # Of the settings only the event counts here: the volume is seen from no site.
    rows = _event_rows(
        tracks, np.unique(tracks.track), CuesConfig(lat_deg=0.0, lon_deg=0.0, at="burnout")
    )
    rows = rows[_reasons(tracks, rows) == ""]
    for estimate in map(tracks.take, rows[:, None].tolist()):
        start_s = float(estimate.available_s[0])
        end_s = float(_end_s(estimate, forces)[0])
        if start_s < end_s:
            time_s = np.linspace(start_s, end_s, 2 + int((end_s - start_s) / step_s))
            yield _flown(estimate, time_s, forces)


def _flown(estimate: Tracks, time_s: FloatArray, forces: Forces) -> FlownVolume:
    places = _places(estimate.take([0] * len(time_s)), time_s, forces)
    covariance_m2 = places.root_m @ places.root_m.mT
    return FlownVolume(int(estimate.track[0]), time_s, places.position_m, covariance_m2)


def _end_s(estimates: Tracks, forces: Forces) -> FloatArray:
    """Return the scene times (n,), s, at which targets come down, or the end of the search."""
    tick_s = estimates.tick_s
    state = ecef_to_eci_state(estimates.state[:, :3], estimates.state[:, 3:], tick_s)
    duration_s, _ = impact(*state, forces=forces, within_s=LONGEST_FLIGHT_S)
    return tick_s + np.where(np.isfinite(duration_s), duration_s, LONGEST_FLIGHT_S)


def _event_rows(tracks: Tracks, numbers: IntArray, config: CuesConfig) -> IntArray:
    """Return the row (n,) of the event of each track, -1 for one without it."""
    event = config.at
    if event in REPORTED_TYPES:
        share = tracks.type_probability[:, REPORTED_TYPES.index(event)]
    else:
        share = tracks.probability_launch
    happens = {
        "first": np.full(len(tracks), True),
        "burnout": tracks.probability_burning < BURNING,
    }.get(event, share > config.probability)
    candidates = np.flatnonzero(happens)
    owners, first = np.unique(tracks.track[candidates], return_index=True)
    rows = np.full(len(numbers), -1)
    rows[np.searchsorted(numbers, owners)] = candidates[first]
    return rows


def _reasons(tracks: Tracks, rows: IntArray) -> ObjectArray:
    """Return why tracks have no volume from their rows (n,); "" for those that may have one."""
    estimates = tracks.take(np.maximum(rows, 0))
    is_known = np.isfinite(estimates.state).all(axis=1)
    is_known &= np.isfinite(estimates.state_covariance).all(axis=(1, 2))
    burning = ~(estimates.probability_burning < BURNING)
    reasons = np.select(
        [rows < 0, ~is_known, burning], ["no event", "no state", "may still burn"], ""
    )
    return reasons.astype(object)


def _estimate(tracks: Tracks, row: int) -> dict[str, float | None]:
    """Return the figures of a track's estimate in a row; None for -1, and what is unknown."""
    columns = {
        "event_s": tracks.tick_s,
        "available_s": tracks.available_s,
        "probability_launch": tracks.probability_launch,
        "probability_burning": tracks.probability_burning,
        "probability_relights": tracks.probability_relights,
    }
    return {
        name: float(column[row]) if row >= 0 and np.isfinite(column[row]) else None
        for name, column in columns.items()
    }


def _times(estimates: Tracks, forces: Forces, config: CuesConfig) -> tuple[FloatArray, ObjectArray]:
    """Return the times (n,), s, at which targets are first in view, nan for none, and reasons."""
    tick_s = estimates.tick_s
    if not len(tick_s):
        return tick_s, np.empty(0, dtype=object)
    state = ecef_to_eci_state(estimates.state[:, :3], estimates.state[:, 3:], tick_s)
    end_s = _end_s(estimates, forces)
    # Beyond the end by more than rounding, so that the last sample has a position.
    flights = free_flight_ephemeris(tick_s, end_s + _STEP_S, *state, forces=forces)
    site_m = _site_m(config)
    mask_rad = np.radians(config.mask_deg)

    def above_mask(row: IntArray, time_s: FloatArray) -> FloatArray:
        return elevation_rad(site_m, flights.position_m(row, time_s)) - mask_rad

    asked_s = estimates.available_s if config.horizon_s is None else tick_s + config.horizon_s
    start_s = np.minimum(asked_s, end_s)
    stop_s = end_s if config.horizon_s is None else start_s
    in_view = (asked_s < end_s) & (above_mask(np.arange(len(tick_s)), start_s) >= 0.0)
    crossings = zero_crossings(above_mask, start_s, stop_s, step_s=_STEP_S)
    rising, first = np.unique(crossings.row[crossings.rises], return_index=True)
    time_s = np.full(len(tick_s), np.nan)
    time_s[rising] = crossings.time_s[crossings.rises][first]
    time_s[in_view] = start_s[in_view]
    cases = [in_view, np.isfinite(time_s)]
    return time_s, np.select(cases, ["in view", "rises"], "not in view").astype(object)


class _Places(NamedTuple):
    """Targets at times (n,), s, after estimates that were available at others: ECEF positions
    (n, 3), m, and roots (n, 3, 6) of their covariances.
    """

    available_s: FloatArray
    time_s: FloatArray
    position_m: FloatArray
    root_m: FloatArray


def _places(estimates: Tracks, time_s: FloatArray, forces: Forces) -> _Places:
    """Return the places of targets at times (n,), s."""
    variance, axes = np.linalg.eigh(estimates.state_covariance)
    steps = (axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :]).mT
    mean = estimates.state[:, None, :]
    states = np.concatenate([mean, mean + steps, mean - steps], axis=1)
    tick_s = estimates.tick_s[:, None]
    position, velocity = ecef_to_eci_state(states[..., :3], states[..., 3:], tick_s)
    arrived, _ = propagate(position, velocity, time_s[:, None] - tick_s, forces)
    arrived = eci_to_ecef(arrived, time_s[:, None])
    upper, lower = np.split(arrived[:, 1:], 2, axis=1)
    root_m = 0.5 * (upper - lower).mT
    return _Places(estimates.available_s, time_s, arrived[:, 0], root_m)


def _volumes(run: Any, places: _Places, config: CuesConfig) -> list[Volume]:
    """Return the volumes of places, seen from the site."""
    site_m = _site_m(config)
    axes = local_axes(site_m)
    angles = azimuth_elevation_range_in_axes(places.position_m - site_m, axes)
    sight = _sight_axes(angles)
    root_m = axes @ places.root_m
    sight_root = sight @ root_m
    covariance = root_m @ root_m.mT
    sigma = np.sqrt(np.sum(sight_root**2, axis=2)) / angles.range_m[:, None]
    azimuth_deg = np.degrees(sigma[:, 0] / np.cos(angles.elevation_rad))
    elevation_deg = np.degrees(sigma[:, 1])
    range_m = sigma[:, 2] * angles.range_m
    determinant = np.maximum(np.linalg.det(covariance), 0.0)
    columns = {
        "time_s": places.time_s,
        "react_s": places.time_s - places.available_s,
        "azimuth_deg": np.degrees(angles.azimuth_rad),
        "elevation_deg": np.degrees(angles.elevation_rad),
        "range_m": angles.range_m,
        "azimuth_sigma_deg": azimuth_deg,
        "elevation_sigma_deg": elevation_deg,
        "range_sigma_m": range_m,
        "azimuth_95_deg": np.minimum(_INTERVAL_SIGMAS * azimuth_deg, 180.0),
        "elevation_95_deg": _INTERVAL_SIGMAS * elevation_deg,
        "range_95_m": _INTERVAL_SIGMAS * range_m,
        **_sky_ellipse(sight_root[:, :2] / angles.range_m[:, None, None]),
        "range_depth_m": 2.0 * _INTERVAL_SIGMAS * range_m,
        "ellipsoid_m3": 4.0 / 3.0 * np.pi * ELLIPSOID_SIGMAS**3 * np.sqrt(determinant),
        "position_ecef_m": places.position_m,
        "covariance_m2": covariance,
    }
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    times = timestamps(run, places.time_s)
    return [
        Volume(time=time, **dict(zip(columns, row, strict=True)))
        for time, row in zip(times, rows, strict=True)
    ]


def _sky_ellipse(root_rad: FloatArray) -> dict[str, FloatArray]:
    """Return the columns of ellipses on the sky that hold directions whose covariances, along
    azimuth and elevation, have roots (n, 2, k), rad.
    """
    # The axes of an ellipse have the unit of the roots.
    major_rad, minor_rad, turn_rad = containment_ellipse(root_rad @ root_rad.mT)
    return {
        "semi_major_deg": np.degrees(major_rad),
        "semi_minor_deg": np.degrees(minor_rad),
        "orientation_deg": np.degrees(turn_rad),
        "solid_angle_sr": np.pi * major_rad * minor_rad,
    }


def _sight_axes(angles: AzimuthElevationRange) -> FloatArray:
    """Return axes (n, 3, 3) in east, north and up: along azimuth, elevation and range."""
    azimuth = angles.azimuth_rad
    elevation = angles.elevation_rad
    level = np.stack([np.sin(azimuth), np.cos(azimuth), 0.0 * azimuth], axis=1)
    aside = level[:, [1, 0, 2]] * np.array([1.0, -1.0, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    rise = np.sin(elevation)[:, None]
    base = np.cos(elevation)[:, None]
    return np.stack([aside, base * up - rise * level, base * level + rise * up], axis=1)


def _site_m(config: CuesConfig) -> FloatArray:
    """Return the ECEF position (3,) of the site, m."""
    place = np.radians(config.lat_deg), np.radians(config.lon_deg)
    return geodetic_to_ecef(*place, config.height_m)
