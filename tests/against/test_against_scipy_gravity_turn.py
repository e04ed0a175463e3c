"""Gravity turns against scipy's integrator: inertial equations, written here, and other code for
the Earth.
"""

import math
from itertools import pairwise

import numpy as np
import pyproj
import pytest
from scipy.integrate import solve_ivp

from opir_core.builtin.configs import AimConfig, LaunchConfig
from opir_core.builtin.gravity_turn_targets import gravity_turn_targets
from opir_core.builtin.target_models import GravityTurnConfig
from opir_core.flight.forces import Drag, ExponentialAtmosphere, Forces
from opir_core.flight.staged.staging import stagings
from opir_core.interfaces.contexts import TargetContext

MU = 3.986004418e14
WHIRL = 7.292115e-5
A = 6378137.0
F = 1 / 298.257223563
E2 = F * (2 - F)
J2 = 1.082626683553e-3
J2_RADIUS = 6378136.3
GEOD = pyproj.Geod(ellps="WGS84")
TO_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
TO_GEODETIC = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)

#: What the boost meets without drag in the scene, as the model's page states it.
BOOST_AIR = (1.225, 7500.0)
OTHER_AIR = (1.4, 6900.0)
COAST_BETA = 3000.0


def height_m(position):
    """Return the geodetic height by fixed-point iteration of the latitude (Torge, Geodesy, section
    4.1).
    """
    across = math.hypot(position[0], position[1])
    z = position[2]
    tangent = z / across / (1 - E2)
    for _ in range(6):
        sine = tangent / math.sqrt(1 + tangent * tangent)
        tangent = (z + E2 * A / math.sqrt(1 - E2 * sine * sine) * sine) / across
    cosine = 1 / math.sqrt(1 + tangent * tangent)
    return across / cosine - A / math.sqrt(1 - E2 * (tangent * cosine) ** 2)


def gravity(position, has_j2):
    x, y, z = position
    r = math.sqrt(x * x + y * y + z * z)
    pull = -MU / r**3 * position
    if has_j2:
        factor = -1.5 * MU * J2 * J2_RADIUS**2 / r**5
        pull = pull + factor * np.array([x, y, 3 * z]) - factor * 5 * z * z / r**2 * position
    return pull


def drag(position, relative, beta, air):
    density = air[0] * math.exp(-height_m(position) / air[1])
    return -density * np.linalg.norm(relative) * relative / (2 * beta)


def to_inertial(vector, t):
    cosine = math.cos(WHIRL * t)
    sine = math.sin(WHIRL * t)
    return np.array(
        [cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1], vector[2]]
    )


class Flight:
    """One flight, from the settings and from the solved azimuth, kick and cut-off."""

    def __init__(self, staging, config, truth, has_j2, air, coast_air):
        self.stages = staging.stages
        self.tail = staging.tail_off_s
        self.beta = staging.ballistic_coefficient_kg_m2
        self.rise = staging.vertical_rise_s
        self.turned = staging.vertical_rise_s + staging.pitch_over_s
        self.kick = math.radians(truth["kick_deg"])
        azimuth = math.radians(truth["azimuth_deg"])
        self.has_j2 = has_j2
        self.air = air
        self.coast_air = coast_air
        self.burnout = truth["burnout_s"] - truth["ignition_s"]
        lat = math.radians(config.launch.lat_deg)
        lon = math.radians(config.launch.lon_deg)
        east = np.array([-math.sin(lon), math.cos(lon), 0.0])
        north = np.array(
            [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)]
        )
        self.up = np.array(
            [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]
        )
        self.heading = math.sin(azimuth) * east + math.cos(azimuth) * north
        place = (config.launch.lon_deg, config.launch.lat_deg, config.launch.height_m)
        self.start = np.array(TO_ECEF.transform(*place))
        self.target_height = config.aim.height_m

    def stage_at(self, t):
        """Return number, ignition and end of the stage that flies (or has last flown) at a time."""
        ignition = 0.0
        for number, stage in enumerate(self.stages):
            if t < ignition + stage.burn_time_s + stage.gap_s or number == len(self.stages) - 1:
                last = number == len(self.stages) - 1
                return stage, ignition, self.burnout if last else ignition + stage.burn_time_s
            ignition += stage.burn_time_s + stage.gap_s
        raise AssertionError

    def untailed(self, stage, since):
        """Return the acceleration of constant thrust and mass flow that gains the ideal speed."""
        q = 1 - 1 / stage.growth
        burn = stage.burn_time_s
        grid, weight = np.polynomial.legendre.leggauss(60)
        whole = 0.5 * (burn - self.tail)
        middle = np.sum(weight / (1 - q * (grid + 1) * whole / burn)) * whole
        amplitude = stage.ideal_speed_m_s / (
            middle + 0.5 * self.tail / (1 - q * (burn - self.tail) / burn)
        )
        return amplitude / (1 - q * since / burn)

    def thrust(self, t):
        stage, ignition, end = self.stage_at(t)
        cut = end - self.tail
        if t >= end:
            return 0.0
        if t <= cut:
            return self.untailed(stage, t - ignition)
        return self.untailed(stage, cut - ignition) * (end - t) / self.tail

    def direction(self, t, relative):
        if t <= self.rise:
            return to_inertial(self.up, t)
        along = relative / np.linalg.norm(relative)
        if t >= self.turned:
            return along
        lead = self.kick * math.sin(math.pi * (t - self.rise) / (self.turned - self.rise)) ** 2
        heading = to_inertial(self.heading, t)
        ahead = heading - heading @ along * along
        return math.cos(lead) * along + math.sin(lead) * ahead / np.linalg.norm(ahead)

    def rates(self, middle):
        """Return the right side within a piece, which is that of its middle where pieces meet."""
        boosts = middle < self.burnout
        dark = self.thrust(middle) == 0.0

        def right_side(t, state):
            position = state[:3]
            velocity = state[3:]
            relative = velocity - WHIRL * np.array([-position[1], position[0], 0.0])
            pull = gravity(position, self.has_j2)
            if boosts:
                pull = pull + drag(position, relative, self.beta, self.air)
            elif self.coast_air:
                pull = pull + drag(position, relative, COAST_BETA, self.coast_air)
            if boosts and not dark:
                pull = pull + self.thrust(t) * self.direction(t, relative)
            return np.concatenate([velocity, pull])

        return right_side

    def pieces(self):
        edges = [0.0, self.rise, self.turned]
        ignition = 0.0
        for stage in self.stages[:-1]:
            end = ignition + stage.burn_time_s
            edges += [end - self.tail, end, end + stage.gap_s]
            ignition = end + stage.gap_s
        return sorted({*edges, self.burnout - self.tail, self.burnout})

    def integrated(self):
        """Return the pieces of the boost and of the free flight to impact."""
        state = np.concatenate([self.start, WHIRL * np.array([-self.start[1], self.start[0], 0.0])])
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-6, "dense_output": True}
        parts = []
        edges = self.pieces()
        for begin, end in pairwise(edges):
            # Just inside the piece at its ends, where the thrust of the next one would begin.
            inside = 1e-9 * (end - begin)
            right_side = self.rates(0.5 * (begin + end))

            def within(t, y, right_side=right_side, low=begin + inside, high=end - inside):
                return right_side(min(max(t, low), high), y)

            parts.append(solve_ivp(within, (begin, end), state, **options))
            state = parts[-1].y[:, -1]

        def down(t, y):
            return height_m(y[:3]) - self.target_height

        down.terminal = True
        down.direction = -1.0
        coast = solve_ivp(
            self.rates(math.inf), (self.burnout, 2e4), state, events=down, max_step=50.0, **options
        )
        return [*parts, coast]


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


def compare(targets, row, truth, parts, config):
    start = truth["ignition_s"]
    for number, part in enumerate(parts):
        inside = np.linspace(part.t[0], part.t[-1], 23)
        if number == len(parts) - 1:
            inside = inside[:-1]
        expected = part.sol(inside)
        turned = np.array(
            [to_inertial(column, -t) for column, t in zip(expected[:3].T, inside, strict=True)]
        )
        rows = np.full(len(inside), row, dtype=np.int32)
        found = targets.position_ecef_m(rows, np.clip(start + inside, start, targets.end_s[row]))
        assert np.abs(found - turned).max() < 1.0, (config.staging, number)
        if number < len(parts) - 1:
            carried = expected[3:] - WHIRL * np.array(
                [-expected[1], expected[0], np.zeros(len(inside))]
            )
            velocity = np.array(
                [to_inertial(column, -t) for column, t in zip(carried.T, inside, strict=True)]
            )
            _, speed = targets.flights.state(rows, start + inside)
            assert np.abs(speed - velocity).max() < 1e-2, (config.staging, number)
    end = parts[-1]
    impact = to_inertial(end.y[:3, -1], -end.t[-1])
    aim = np.array(TO_ECEF.transform(config.aim.lon_deg, config.aim.lat_deg, config.aim.height_m))
    assert np.linalg.norm(impact - aim) < 10.0, config.staging
    assert abs(end.t[-1] + start - truth["impact"]["time_s"]) < 0.01
    lon, lat, _ = TO_GEODETIC.transform(*impact)
    reported = truth["impact"]
    assert GEOD.inv(lon, lat, reported["lon_deg"], reported["lat_deg"])[2] < 10.0
