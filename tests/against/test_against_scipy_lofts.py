"""Lofts of gravity turns against scipy: own equations of flight, and own searches of the steepest
flights.
"""

import math
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest
from scipy.optimize import root
from scipy_gravity_turns import BOOST_AIR, GEOD, TO_GEODETIC, Flight, height_m, to_inertial

from opir_core.builtin.configs import AimConfig, LaunchConfig
from opir_core.builtin.gravity_turn_targets import gravity_turn_targets
from opir_core.builtin.target_models import GravityTurnConfig
from opir_core.flight.staged.staging import stagings
from opir_core.interfaces.contexts import TargetContext

LOFTS = (0.0, 0.3, 0.7, 1.0)

#: Farthest aims, m: of the class, or what the stages fly in any direction.
PRESETS = {"SRBM": 300e3, "IRBM": 5500e3, "ICBM_liquid": 15000e3}


class RoughFlight(Flight):
    """A flight to about a kilometre at impact."""

    options: ClassVar = {"method": "RK45", "rtol": 1e-7, "atol": 1e-2, "dense_output": True}

    def apogee_and_impact(self):
        """Return the height of the apogee, m, and latitude and longitude of the impact, degrees."""
        coast = self.integrated()[-1]
        between = np.linspace(coast.t[0], coast.t[-1], 300)
        apogee_m = max(height_m(position) for position in coast.sol(between)[:3].T)
        lon, lat, _ = TO_GEODETIC.transform(*to_inertial(coast.y[:3, -1], -coast.t[-1]))
        return apogee_m, lat, lon


def config_of(name, range_m, number, **settings):
    random = np.random.default_rng([211, number])
    lat = random.uniform(-60.0, 60.0)
    lon = random.uniform(-180.0, 180.0)
    bearing = random.uniform(0.0, 360.0)
    aim_lon, aim_lat, _ = GEOD.fwd(lon, lat, bearing, range_m)
    launch = LaunchConfig(lat_deg=lat, lon_deg=lon, time_s=0.0)
    aim = AimConfig(lat_deg=aim_lat, lon_deg=aim_lon)
    return GravityTurnConfig(
        type=name.split("_")[0], staging=name, launch=launch, aim=aim, **settings
    )


def truths(configs):
    numbers = tuple(map(str, range(len(configs))))
    context = TargetContext(
        ids=numbers, paths=numbers, forces="kepler", epoch_us=0, free_flight=True
    )
    return gravity_turn_targets(configs, context).truth()


def flown(config, truth):
    return RoughFlight(
        stagings()[config.staging], config, truth, False, BOOST_AIR, None
    ).apogee_and_impact()


def miss_m(config, lat, lon):
    """Return the miss, m, towards east and north, by azimuth and distance from the launch point."""
    place = config.launch.lon_deg, config.launch.lat_deg
    offsets = []
    for end in ((lon, lat), (config.aim.lon_deg, config.aim.lat_deg)):
        bearing, _, distance_m = GEOD.inv(*place, *end)
        offsets.append(distance_m * np.exp(1j * math.radians(bearing)))
    difference = offsets[0] - offsets[1]
    return difference.imag, difference.real


def steepest_apogee_m(config):
    """Return the apogee, m, of a flight to the aim that burns to the end, from a search that begins
    with no kick.
    """
    burn_s = sum(stage.burn_time_s + stage.gap_s for stage in stagings()[config.staging].stages)

    def trial(kick):
        settings = {
            "kick_deg": math.degrees(math.hypot(*kick)),
            "azimuth_deg": math.degrees(math.atan2(*kick)),
        }
        return flown(config, {**settings, "burnout_s": burn_s, "ignition_s": 0.0})

    result = root(
        lambda kick: miss_m(config, *trial(kick)[1:]),
        [1e-4, 1e-4],
        options={"eps": 1e-4, "xtol": 1e-5},
    )
    apogee_m, lat, lon = trial(result.x)
    assert math.hypot(*miss_m(config, lat, lon)) < 20e3
    return apogee_m


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_every_loft_reaches_every_range_with_apogees_between_those_of_its_ends(name):
    ranges_m = np.linspace(0.02, 1.0, 20) * PRESETS[name]
    configs = [
        config_of(name, range_m, number, loft=loft)
        for number, range_m in enumerate(ranges_m)
        for loft in LOFTS
    ]
    flights = [flown(*pair) for pair in zip(configs, truths(configs), strict=True)]
    for config, (_, lat, lon) in zip(configs, flights, strict=True):
        assert math.hypot(*miss_m(config, lat, lon)) < 5e3
    apogees_m = np.array([apogee_m for apogee_m, _, _ in flights]).reshape(20, len(LOFTS))
    lowest_m = apogees_m[:, :1]
    highest_m = apogees_m[:, -1:]
    assert all((later > earlier).all() for earlier, later in pairwise(apogees_m.T))
    assert apogees_m == pytest.approx(lowest_m + np.array(LOFTS) * (highest_m - lowest_m), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_a_loft_of_one_is_the_steepest_flight_that_an_own_search_finds(name):
    ranges_m = np.linspace(0.02, 0.95, 6) * PRESETS[name]
    configs = [
        config_of(name, range_m, 50 + number, loft=1.0) for number, range_m in enumerate(ranges_m)
    ]
    for config, truth in zip(configs, truths(configs), strict=True):
        assert flown(config, truth)[0] == pytest.approx(steepest_apogee_m(config), rel=0.01)


@pytest.mark.slow
def test_a_named_apogee_is_flown():
    configs = [config_of("ICBM_liquid", 1063e3, number, apogee_km=2800.0) for number in range(4)]
    for config, truth in zip(configs, truths(configs), strict=True):
        apogee_m, lat, lon = flown(config, truth)
        assert apogee_m == pytest.approx(2800e3, rel=0.01)
        assert math.hypot(*miss_m(config, lat, lon)) < 5e3
