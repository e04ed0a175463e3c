"""Gravity turns against scipy's integrator: inertial equations of their own, and other code for the
Earth.
"""

import numpy as np
import pytest
from scipy_gravity_turns import (
    BOOST_AIR,
    COAST_BETA,
    GEOD,
    TO_ECEF,
    TO_GEODETIC,
    WHIRL,
    Flight,
    to_inertial,
)

from opir_core.builtin.configs import AimConfig, LaunchConfig
from opir_core.builtin.gravity_turn_targets import gravity_turn_targets
from opir_core.builtin.target_models import GravityTurnConfig
from opir_core.flight.forces import Drag, ExponentialAtmosphere, Forces
from opir_core.flight.staged.staging import stagings
from opir_core.interfaces.contexts import TargetContext

OTHER_AIR = (1.4, 6900.0)


def built(cases, forces):
    configs = []
    for name, lat, lon, bearing, range_m, loft, height in cases:
        aim_lon, aim_lat, _ = GEOD.fwd(lon, lat, bearing, range_m)
        configs.append(
            GravityTurnConfig(
                type=name.split("_")[0],
                staging=name,
                loft=loft,
                launch=LaunchConfig(lat_deg=lat, lon_deg=lon, time_s=37.0, height_m=height),
                aim=AimConfig(lat_deg=aim_lat, lon_deg=aim_lon, height_m=0.5 * height),
                ballistic_coefficient_kg_m2=COAST_BETA,
            )
        )
    rows = range(len(cases))
    context = TargetContext(
        ids=tuple(map(str, rows)),
        paths=tuple(map(str, rows)),
        forces=forces,
        epoch_us=0,
        free_flight=True,
    )
    return configs, gravity_turn_targets(configs, context)


#: Staging, launch (deg), bearing (deg), range (m), loft, height (m).
CASES = [
    ("SRBM", 34.0, -120.0, 200.0, 140e3, 0.0, 300.0),
    ("SRBM_long", -12.0, 131.0, 80.0, 700e3, 0.5, 0.0),
    ("MRBM", 2.0, 10.0, 310.0, 1500e3, -0.4, 1200.0),
    ("MRBM_two_stage", 55.0, 40.0, 120.0, 2600e3, 0.3, 0.0),
    ("IRBM", -40.0, -65.0, 20.0, 4200e3, 0.0, 0.0),
    ("SLBM_two_stage", 30.0, 150.0, 60.0, 4800e3, 0.0, 0.0),
    ("SLBM", 60.0, 0.0, 280.0, 8500e3, -0.3, 0.0),
    ("ICBM_solid", 48.0, 60.0, 350.0, 10000e3, 0.0, 100.0),
    ("ICBM_liquid", 20.0, 80.0, 45.0, 11000e3, 0.4, 0.0),
]


@pytest.mark.slow
@pytest.mark.parametrize("has_forces", [False, True])
def test_gravity_turns_follow_the_equations_from_ignition_to_impact(has_forces):
    air = OTHER_AIR if has_forces else BOOST_AIR
    drag_model = Drag(COAST_BETA, ExponentialAtmosphere(*OTHER_AIR))
    forces = Forces(zonal=("j2",), drag=drag_model) if has_forces else "kepler"
    configs, targets = built(CASES, forces)
    for row, (config, truth) in enumerate(zip(configs, targets.truth(), strict=True)):
        flight = Flight(
            stagings()[config.staging],
            config,
            truth,
            has_forces,
            air,
            OTHER_AIR if has_forces else None,
        )
        compare(targets, row, truth, flight.integrated(), config)


def turned_back(vectors, times):
    """Return vectors (3, n) at times as inertial ones, (n, 3)."""
    pairs = zip(vectors.T, times, strict=True)
    return np.array([to_inertial(vector, -time_s) for vector, time_s in pairs])


def compare(targets, row, truth, parts, config):
    start = truth["ignition_s"]
    for number, stage in enumerate(parts):
        is_last = number == len(parts) - 1
        inside = np.linspace(stage.t[0], stage.t[-1], 23)[: -1 if is_last else None]
        expected = stage.sol(inside)
        rows = np.full(len(inside), row, dtype=np.int32)
        result = targets.position_ecef_m(rows, np.clip(start + inside, start, targets.end_s[row]))
        gap = np.abs(result - turned_back(expected[:3], inside)).max()
        assert gap < 1.0, (config.staging, number)
        if not is_last:
            whirl = WHIRL * np.array([-expected[1], expected[0], np.zeros(len(inside))])
            velocity = turned_back(expected[3:] - whirl, inside)
            _, speed = targets.flights.state(rows, start + inside)
            assert np.abs(speed - velocity).max() < 1e-2, (config.staging, number)
    compare_impact(parts[-1], truth, config)


def compare_impact(fall, truth, config):
    reported = truth["impact"]
    impact = to_inertial(fall.y[:3, -1], -fall.t[-1])
    aim = np.array(TO_ECEF.transform(config.aim.lon_deg, config.aim.lat_deg, config.aim.height_m))
    assert np.linalg.norm(impact - aim) < 10.0, config.staging
    assert abs(fall.t[-1] + truth["ignition_s"] - reported["time_s"]) < 0.01
    lon, lat, _ = TO_GEODETIC.transform(*impact)
    assert GEOD.inv(lon, lat, reported["lon_deg"], reported["lat_deg"])[2] < 10.0
