"""Synthetic launches and hot sources: positions, trajectories and brightness drawn from stated
priors.

They are independent of the scene: draws are from a low-discrepancy sequence (Kronecker's, of the
generalised golden ratio), the same in every scene, for a satellite of the sensor's radius over the
equator, uniform in longitude. Their measurements use the scene's own atmosphere and background.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple, cast

import numpy as np
from attrs import evolve, frozen
from scipy.special import ndtri

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight import BoostPath, aim, ascent, boost_path, launch_site
from opir_core.geometry import (
    Geodetic,
    components,
    ecef_to_geodetic,
    elevation_rad,
    geodetic_to_ecef,
    length,
    vector,
)
from opir_core.planning import Targets
from opir_core.plugin import (
    EMITTER_TYPES,
    Ballistic,
    Band,
    BoostProfile,
    EquilibriumGlide,
    Exposures,
    OrbitInsertion,
    Plume,
    SignatureContext,
    Signatures,
    TargetClass,
    Trajectories,
)
from opir_core.scene import MAXIMUM_BANDS
from opir_photons.classification.hot_sources import KINDS
from opir_photons.radiometry.configs import PlumeConfig
from opir_photons.radiometry.planck import band_radiance
from opir_photons.radiometry.plume import PlumeSignatures, plume_signatures
from opir_photons.radiometry.propellants import log_sigma, propellants

EARTH_RADIUS_M = 6.371e6

#: Looks per burn.
MOMENTS = 40

#: Brightness draws per launch.
DRAWS = 4

#: Least sine of the elevation.
LOWEST_SINE = 0.02


class ClassFlight(NamedTuple):
    """A boost that a target class flies, its flight after burnout, and its plume."""

    profile: BoostProfile
    after_burnout: Ballistic | OrbitInsertion | EquilibriumGlide
    plume: Plume


def flights_of(classes: Iterable[TargetClass]) -> tuple[tuple[ClassFlight, ...], list[list[int]]]:
    """Return the distinct flights of classes, and of each class the numbers of its flights."""
    flights = list[ClassFlight]()
    numbers = list[list[int]]()
    for kind in classes:
        of_class = [
            ClassFlight(profile, kind.after_burnout, kind.plume(profile.name))
            for profile in kind.profiles
        ]
        flights += [flight for flight in of_class if flight not in flights]
        numbers.append([flights.index(flight) for flight in of_class])
    return tuple(flights), numbers


@frozen(eq=False)
class SyntheticPlumes(Signatures):
    """Plumes of launches (n,), along their trajectories."""

    plumes: Signatures
    path: BoostPath

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,), W/sr."""
        return self.plumes.intensity_w_sr(
            band, target, time_since_ignition_s, altitude_m, aspect_rad
        )

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return the angles (n,) between the direction of flight and the sensor, rad; at rest the
        direction is up.
        """
        _, velocity = self.path.state(target.astype(np.int64), time_s)
        speed = np.sqrt(np.square(velocity).sum(axis=1))[:, None]
        heading = velocity / np.where(speed > 0.0, speed, 1.0)
        heading = np.where(speed > 0.0, heading, self.path.plane.up[target])
        return np.arccos(np.clip((heading * to_sensor_ecef).sum(axis=1), -1.0, 1.0))


@frozen(eq=False)
class SyntheticSources(Signatures):
    """Hot sources (n,): in-band intensities (bands, n), W/sr, isotropic and constant."""

    peak_w_sr: FloatArray

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,), W/sr."""
        return self.peak_w_sr[band][target]

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return zeros (n,): sources are isotropic."""
        return np.zeros(len(target))


@frozen(eq=False)
class SyntheticPaths:
    """The places of synthetic objects: on the paths of launches, or fixed (n, 3)."""

    of: BoostPath | FloatArray

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3), m."""
        if isinstance(self.of, BoostPath):
            return self.of.state(target.astype(np.int64), time_s)[0]
        return self.of[target]


@frozen(eq=False)
class SyntheticLooks:
    """Synthetic looks with signatures; `number` (n,) is the profile or kind, `share` (n,) the
    relative frequency of a look among those of its number. Looks at launches are launch by launch,
    `MOMENTS` each, in order of time.
    """

    exposures: Exposures
    signatures: Signatures
    targets: Targets
    number: IntArray
    share: FloatArray
    step_s: FloatArray


def synthetic_launches(
    radius_m: float, flights: Sequence[ClassFlight], plumes: Signatures, launches: int
) -> SyntheticLooks:
    """Return looks at launches of every flight from satellites at a distance from the Earth's
    centre, m.

    `plumes` are those of the launches, flight by flight.
    """
    flown = [flight for flight in flights for _ in range(launches)]
    drawn = low_discrepancy_points(len(flown), 5)
    sensor_m, site = sites(radius_m, drawn[:, :3])
    path = boosts(site, flown, drawn[:, 3:5])
    possible = np.flatnonzero(np.isfinite(path.burnout_speed_m_s))
    flight = possible // launches
    count = np.bincount(flight, minlength=len(flights))
    launch = np.repeat(possible, MOMENTS)
    number = np.repeat(flight, MOMENTS)
    step_s = path.burnout_s[launch] / MOMENTS
    time_s = (np.tile(np.arange(MOMENTS), len(possible)) + 0.5) * step_s
    return SyntheticLooks(
        exposures=exposures_of(launch, time_s, path.state(launch, time_s)[0], sensor_m[launch]),
        signatures=SyntheticPlumes(plumes, path),
        targets=targets_of(SyntheticPaths(path), np.zeros(len(flown))),
        number=number,
        share=step_s / count[number],
        step_s=step_s,
    )


def boosts(site: Geodetic, flown: Sequence[ClassFlight], drawn: FloatArray) -> BoostPath:
    """Return the boosts of flights (n,) from sites, ignited at 0, in drawn directions and over
    drawn ranges, (n, 2).

    The burnout speed is nan where no ballistic flight reaches its range. A glider has the speed
    that its glide takes, a flight into orbit that of its profile.
    """
    profiles = [flight.profile for flight in flown]
    azimuth_rad = 2.0 * np.pi * drawn[:, 1]
    speed_m_s = np.array([profile.burnout_speed_m_s for profile in profiles])
    angle_rad = np.array([profile.burnout_flight_path_angle_rad for profile in profiles])
    rows = np.flatnonzero([isinstance(flight.after_burnout, Ballistic) for flight in flown])
    if len(rows):
        ballistic = [profiles[row] for row in rows.tolist()]
        from_site = Geodetic(*(column[rows] for column in site))
        shot = aim(from_site, _aims(from_site, ballistic, drawn[rows]), 0.0, ballistic)
        azimuth_rad[rows] = shot.azimuth_rad
        angle_rad[rows] = shot.burnout_flight_path_angle_rad
        speed_m_s[rows] = np.where(shot.converged, shot.burnout_speed_m_s, np.nan)
    range_m = _ranges_m(profiles, drawn[:, 0])
    for row, flight in enumerate(flown):
        if isinstance(flight.after_burnout, EquilibriumGlide):
            speed_m_s[row] = _glide_speed_m_s(flight.after_burnout, range_m[row])
    return boost_path(launch_site(*site), 0.0, azimuth_rad, speed_m_s, ascent(profiles, angle_rad))


def _glide_speed_m_s(glide: EquilibriumGlide, range_m: float) -> float:
    """Return the speed at which a glide of this range begins, by the closed form in
    `opir_core.flight.glide`.
    """
    circular = EARTH_MU_M3_S2 / EARTH_RADIUS_M
    decay = math.exp(-2.0 * range_m / (glide.lift_to_drag * EARTH_RADIUS_M))
    return math.sqrt(circular * (1.0 - (1.0 - glide.final_speed_m_s**2 / circular) * decay))


def _ranges_m(profiles: Sequence[BoostProfile], drawn: FloatArray) -> FloatArray:
    """Return ranges (n,), uniform in their logarithm within the limits of profiles, from 50 to
    15 000 km, and 1 % inside them, since positions are on a sphere.
    """
    shortest = np.array([1.01 * max(profile.minimum_range_m, 5e4) for profile in profiles])
    longest = np.array([min(profile.maximum_range_m, 1.5e7) / 1.01 for profile in profiles])
    return shortest * (longest / shortest) ** drawn


def brightness(launches: int, width: int, log_sigma: float, colour_log_sigma: float) -> FloatArray:
    """Return brightness factors (DRAWS, launches, width) of a sensor's bands: common to all bands,
    times one per band.

    They depend on the position of a band in its sensor only, not on other sensors.
    """
    normal = ndtri(low_discrepancy_points(DRAWS * launches, 1 + MAXIMUM_BANDS))
    normal = normal.reshape(DRAWS, launches, -1)
    return np.exp(log_sigma * normal[:, :, :1] + colour_log_sigma * normal[:, :, 1 : 1 + width])


def synthetic_sources(radius_m: float, bands: Sequence[Band], count: int) -> SyntheticLooks:
    """Return looks at hot sources of every kind, `count` of each."""
    drawn = low_discrepancy_points(len(KINDS) * count, 6)
    number = np.repeat(np.arange(len(KINDS)), count)
    sensor_m, site = sites(radius_m, drawn[:, :3])
    height_m = _between([kind.height_m for kind in KINDS], number, drawn[:, 3])
    temperature_k = _between([kind.temperature_k for kind in KINDS], number, drawn[:, 4])
    sigma = np.array([kind.area_log_sigma for kind in KINDS])[number]
    area_m2 = np.array([kind.area_m2 for kind in KINDS], dtype=np.float64)[number]
    shown_m2 = area_m2 * np.exp(sigma * ndtri(drawn[:, 5]))
    peak = [shown_m2 * band_radiance(temperature_k, band.lower_um, band.upper_um) for band in bands]
    place_m = geodetic_to_ecef(site.latitude_rad, site.longitude_rad, height_m)
    now_s = np.zeros(len(number))
    # What moves leaves no light in the frame before, as if it had just begun.
    since_s = [0.5 * kind.shining_s if kind.group == "ground" else 0.0 for kind in KINDS]
    return SyntheticLooks(
        exposures=exposures_of(np.arange(len(number)), now_s, place_m, sensor_m),
        signatures=SyntheticSources(np.maximum(np.array(peak).reshape(len(bands), -1), 0.0)),
        targets=targets_of(SyntheticPaths(place_m), -np.array(since_s)[number]),
        number=number,
        share=np.full(len(number), 1.0 / count),
        step_s=now_s,
    )


def _between(
    limits: Sequence[tuple[float, float]], number: IntArray, drawn: FloatArray
) -> FloatArray:
    """Return values (n,) at the shares `drawn` (n,) between limits by number."""
    low, high = np.array(limits, dtype=np.float64)[number].T
    return low + (high - low) * drawn


def low_discrepancy_points(count: int, dimensions: int) -> FloatArray:
    """Return points (count, dimensions) of Kronecker's low-discrepancy sequence in (0,
    1)^dimensions.

    Its steps are powers of 1/φ, with φ the positive root of x^(d+1) = x + 1.
    """
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (dimensions + 1.0))
    steps = (1.0 / root) ** np.arange(1, dimensions + 1)
    points: FloatArray = np.remainder(0.5 + (1.0 + np.arange(count))[:, None] * steps, 1.0)
    return np.clip(points, 1e-9, 1.0 - 1e-9)


def sites(radius_m: float, drawn: FloatArray) -> tuple[FloatArray, Geodetic]:
    """Return satellites over the equator (n, 3), and ground points uniform in the sine of the
    satellite's elevation.
    """
    longitude, bearing = 2.0 * np.pi * drawn[:, [0, 2]].T
    zeros = np.zeros(len(longitude))
    up = vector(np.cos(longitude), np.sin(longitude), zeros)
    east = vector(-np.sin(longitude), np.cos(longitude), zeros)
    elevation = np.arcsin(LOWEST_SINE + (1.0 - LOWEST_SINE) * drawn[:, 1])
    angle = np.arccos(np.clip(EARTH_RADIUS_M * np.cos(elevation) / radius_m, -1.0, 1.0)) - elevation
    level = np.sin(bearing)[:, None] * east + np.cos(bearing)[:, None] * np.array([0.0, 0.0, 1.0])
    foot = EARTH_RADIUS_M * (np.cos(angle)[:, None] * up + np.sin(angle)[:, None] * level)
    place = ecef_to_geodetic(foot)
    return radius_m * up, Geodetic(place.latitude_rad, place.longitude_rad, zeros)


def _aims(site: Geodetic, profiles: Sequence[BoostProfile], drawn: FloatArray) -> Geodetic:
    """Return aim points: uniform in direction and in the logarithm of range, within the profile's
    limits.
    """
    angle = _ranges_m(profiles, drawn[:, 0]) / EARTH_RADIUS_M
    heading = 2.0 * np.pi * drawn[:, 1]
    site_sine = np.sin(site.latitude_rad)
    site_cosine = np.cos(site.latitude_rad)
    sine = site_sine * np.cos(angle) + site_cosine * np.sin(angle) * np.cos(heading)
    latitude = np.arcsin(np.clip(sine, -1.0, 1.0))
    across = np.sin(heading) * np.sin(angle) * site_cosine
    longitude = site.longitude_rad + np.arctan2(across, np.cos(angle) - site_sine * sine)
    return Geodetic(latitude, longitude, np.zeros(len(angle)))


def launched_plumes(
    bands: Sequence[Band], flights: Sequence[ClassFlight], launches: int
) -> PlumeSignatures:
    """Return the plumes of launches, flight by flight, with the signature model's defaults but the
    propellant.

    The propellant of a class is unknown: each launch draws its own, and the level of the particles
    of that.
    """
    fuels = tuple(propellants().values())
    flown = [flight for flight in flights for _ in range(launches)]
    drawn = low_discrepancy_points(len(flown), 2)
    fuel = (len(fuels) * drawn[:, 0]).astype(np.int64)
    level_log_sigma = np.array([log_sigma(propellant.spread) for propellant in fuels])[fuel]
    settings = [PlumeConfig(propellant=propellant.name) for propellant in fuels]
    names = tuple(flight.profile.name for flight in flown)
    context = SignatureContext(
        bands=tuple(bands),
        ids=names,
        paths=tuple(f"classification: {name}" for name in names),
        types=names,
        profiles=names,
        burn_time_s=np.array([flight.profile.burn_time_s for flight in flown]),
        plumes=tuple(flight.plume for flight in flown),
    )
    plumes = plume_signatures([settings[number] for number in fuel.tolist()], context)
    level = np.exp(level_log_sigma * ndtri(drawn[:, 1]))
    return evolve(plumes, particle_w_sr=plumes.particle_w_sr * level)


def exposures_of(
    target: IntArray, time_s: FloatArray, place_m: FloatArray, sensor_m: FloatArray
) -> Exposures:
    """Return looks (n,) of one sensor at objects at places, from others, (n, 3), m."""
    return Exposures(
        time_s=time_s,
        emission_time_s=time_s,
        scan=np.zeros(len(target), dtype=np.int64),
        sensor=np.zeros(len(target), dtype=np.int32),
        target=target.astype(np.int32),
        range_m=length(*components(place_m - sensor_m)),
        elevation_sine=np.sin(elevation_rad(place_m, sensor_m)),
        target_ecef_m=place_m,
        sensor_ecef_m=sensor_m,
    )


def targets_of(paths: SyntheticPaths, ignition_s: FloatArray) -> Targets:
    """Return the columns of targets that a radiometric environment needs, ignited at times (n,)."""
    count = len(ignition_s)
    code = np.full(count, len(EMITTER_TYPES) - 1, dtype=np.uint8)
    none = np.zeros(count, dtype=np.int32)
    forever = np.full(count, math.inf)
    place = np.arange(count, dtype=np.int32)
    # Only positions are asked for.
    return Targets(
        (), code, ignition_s, forever, forever, (cast(Trajectories, paths),), none, place
    )
