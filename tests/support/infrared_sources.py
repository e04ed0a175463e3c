"""What tests of sources have in common: a context, a region, random fields, and what a sensor is
sent.
"""

import numpy as np
from opir_photons.radiometry.source_configs import FieldConfig

from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.interfaces.radiometric_models import SourceContext
from opir_core.plugin import Band
from opir_core.scene import QuadrangleConfig

SWIR = Band("SWIR", 2.5, 3.0)
MWIR = Band("MWIR", 4.0, 5.0)
HERE = ({"lat_deg": 10.0, "lon_deg": 20.0},)
NOON_US = 1_775_044_800_000_000  # 2026-04-01T12:00:00Z


def context(seed=1, duration_s=600.0, **changes):
    settings = {"bands": (SWIR, MWIR), "id": "fires", "path": "sources[0]", "epoch_us": NOON_US}
    return SourceContext(**settings, seed=seed, duration_s=duration_s, **changes)


def region(south=-10.0, north=20.0, west=30.0, east=60.0):
    return QuadrangleConfig(south_deg=south, north_deg=north, west_deg=west, east_deg=east)


def field(per_million_km2=20.0, where=None, sigma=1.0):
    return FieldConfig(
        region=where or region(), per_million_km2=per_million_km2, area_log_sigma=sigma
    )


def intensity(sources, band=0, time_s=100.0, to_sensor=None, rows=None):
    rows = np.arange(len(sources.ids), dtype=np.int32) if rows is None else rows
    time = np.full(len(rows), time_s)
    place = sources.trajectories.position_ecef_m(rows, time)
    up = local_axes(place)[:, 2] if to_sensor is None else np.broadcast_to(to_sensor, place.shape)
    aspect = sources.signatures.aspect_rad(rows, time, up)
    height = ecef_to_geodetic(place).height_m
    since = time - sources.trajectories.ignition_s[rows]
    return sources.signatures.intensity_w_sr(band, rows, since, height, aspect)
