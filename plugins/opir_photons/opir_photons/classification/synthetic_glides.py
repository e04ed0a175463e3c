"""Synthetic glides: looks at what a class leaves to the air after its burn, as hot as that makes it.

Boosts are those of the synthetic launches of the class; an equilibrium glide follows each, lit by
`opir_photons.radiometry.heating` with the signature model's defaults, without sunlight.
"""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.flight import GlidePath, GlideShape
from opir_core.geometry import components, ecef_to_geodetic, length
from opir_core.plugin import EquilibriumGlide
from opir_photons.classification.synthetic_looks import (
    MOMENTS,
    ClassFlight,
    SyntheticLooks,
    SyntheticPaths,
    SyntheticSources,
    boosts,
    exposures_of,
    low_discrepancy_points,
    sites,
    targets_of,
)
from opir_photons.radiometry.plume import PlumeSignatures

#: Intensity of a burn that stands for the looks before a glide, W/sr: it is seen.
_BURN_W_SR = 1e5


def gliding_rows(flights: Sequence[ClassFlight]) -> list[int]:
    """Return the numbers of the flights that glide after burnout."""
    return [
        number
        for number, flight in enumerate(flights)
        if isinstance(flight.after_burnout, EquilibriumGlide)
    ]


def synthetic_glides(
    radius_m: float,
    flights: Sequence[ClassFlight],
    plumes: PlumeSignatures,
    launches: int,
) -> SyntheticLooks:
    """Return looks at glides of flights from satellites at a distance from the Earth's centre, m.

    `plumes` are those of the launches, flight by flight. Of the `MOMENTS` looks at each the first
    stands for the burn, with no share, so that detections count from ignition on.
    """
    flown = [flight for flight in flights for _ in range(launches)]
    drawn = low_discrepancy_points(len(flown), 5)
    sensor_m, site = sites(radius_m, drawn[:, :3])
    path = boosts(site, flown, drawn[:, 3:5])
    launch = np.arange(len(flown))
    glide = GlidePath.from_burnout(
        *path.state(launch, path.burnout_s), GlideShape.of(flight.after_burnout for flight in flown)
    )
    row = np.repeat(launch, MOMENTS)
    glide_s = glide.duration_s / (MOMENTS - 1)
    step_s = np.repeat(glide_s, MOMENTS)
    since_s = (np.tile(np.arange(MOMENTS), len(flown)) - 0.5) * step_s
    is_burn = since_s < 0.0
    place_m, velocity_m_s = glide.take(row).state(np.maximum(since_s, 0.0))
    light = _intensities_w_sr(plumes, row, place_m, velocity_m_s)
    light[:, is_burn] = _BURN_W_SR
    step_s[is_burn] = path.burnout_s
    looks = np.arange(len(row))
    return SyntheticLooks(
        exposures=exposures_of(looks, 0.0 * since_s, place_m, sensor_m[row]),
        signatures=SyntheticSources(light),
        targets=targets_of(SyntheticPaths(place_m), np.zeros(len(row))),
        number=row // launches,
        share=np.where(is_burn, 0.0, step_s / launches),
        step_s=step_s,
    )


def _intensities_w_sr(
    plumes: PlumeSignatures, row: IntArray, place_m: FloatArray, velocity_m_s: FloatArray
) -> FloatArray:
    """Return the intensities (bands, n) of bodies in their glides, W/sr."""
    bands = range(len(plumes.bands))
    target = row.astype(np.int32)
    height_m = ecef_to_geodetic(place_m).height_m
    speed_m_s = length(*components(velocity_m_s))
    heated = plumes.air_heated_w_sr(list(bands), target, height_m, speed_m_s)
    return np.asarray(plumes.body_w_sr[:, row] + heated)
