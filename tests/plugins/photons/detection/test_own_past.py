"""What a frame difference subtracts of a target: nothing before one lag, much of a slow one, all of
a steady source.
"""

from typing import Any

import numpy as np
from opir_photons.radiometry import FilteredSpot, FrameDifference, PointSpread, filter_weights
from snr_scene import SBIRS, looks_of, scene

import opir_core as opir
from opir_core.plugin import Exposures

LAG_S = 10.0
FIRE = {"model": "fires", "id": "F", "at": [{"lat_deg": 3.0, "lon_deg": -150.0}]}


def signals(temporal: str, **changes: Any) -> tuple[Any, Exposures, np.ndarray]:
    """Return the plan, the looks and the signals (n, B) of a sensor with or without a frame
    difference.
    """
    plane = {
        "temporal_filter": temporal,
        "lag_s": LAG_S,
        "registration_urad": 0.0,
        "drift_urad_s": 0.0,
    }
    sensor = {name: value for name, value in SBIRS.items() if name != "nei_w_m2"}
    plan = opir.compile_plan(scene([{**sensor, "focal_plane": plane}], "IS", **changes))
    looks = looks_of(plan, 5)
    response = plan.detection.response(looks)
    return plan, looks, response.snr * response.noise_w_m2


def test_frame_difference_subtracts_a_displaced_spot() -> None:
    plan, looks, remaining = signals("difference")
    total = signals("none")[2]
    since_s = looks.emission_time_s - plan.targets.ignition_s[looks.target]
    early = since_s < LAG_S
    np.testing.assert_allclose(remaining[early], total[early], rtol=1e-12)
    # The ring of a matched filter is negative: a spot that has left its core adds.
    assert (remaining <= total * 1.2).all()
    # Light of the same targets, seen alone a lag earlier.
    config = plan.sensors[0].radiometer.focal_planes[0]
    pixel_rad = plan.sensors[0].radiometer.ifov_rad
    later = np.flatnonzero((since_s > LAG_S + 0.5) & (since_s < 30.0))[::4]
    assert len(later) >= 20
    for row in later.tolist():
        then = np.flatnonzero(
            (looks.target == looks.target[row])
            & (np.abs(looks.emission_time_s - looks.emission_time_s[row] + LAG_S) < 0.3)
        )
        near = then[
            np.argmin(np.abs(looks.emission_time_s[then] - looks.emission_time_s[row] + LAG_S))
        ]
        rays = [looks.target_ecef_m[each] - looks.sensor_ecef_m[each] for each in (row, near)]
        rays = [ray / np.linalg.norm(ray) for ray in rays]
        moved = np.linalg.norm(rays[0] - rays[1]) / pixel_rad
        for place, band in enumerate(plan.sensors[0].bands):
            middle_um = 0.5 * (band.lower_um + band.upper_um)
            blur = np.hypot(config.blur_urad, config.jitter_urad) * 1e-6
            sigma = np.hypot(np.sqrt(2.0) / np.pi * middle_um * 1e-6 / config.aperture_m, blur)
            weights = filter_weights("matched", 1, float(sigma), pixel_rad)
            spot = FilteredSpot.of(
                weights, PointSpread.of(middle_um, config.aperture_m, float(blur), pixel_rad)
            )
            share = float(spot.response(moved, FrameDifference(LAG_S, 0.0, 0.0)) / spot.response())
            expected = max(total[row, place] - share * total[near, place], 0.0)
            # Looks a lag apart are up to 0.25 s from a lag.
            assert abs(remaining[row, place] - expected) < 0.05 * total[row, place]


def test_steady_sources_are_removed() -> None:
    plan, looks, remaining = signals("difference", sources=[FIRE])
    total = signals("none", sources=[FIRE])[2]
    fire = looks.target == len(plan.scene.targets)
    assert fire.sum() > 20
    assert total[fire].max() > 0.0
    assert remaining[fire].max() < 1e-9 * total[fire].max()
