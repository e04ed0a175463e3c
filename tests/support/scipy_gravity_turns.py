"""Gravity turns by scipy's integrator: inertial equations, written here, and other code for the
Earth.
"""

import math
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pyproj
from scipy.integrate import solve_ivp

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

    options: ClassVar = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-6, "dense_output": True}

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
                is_final = number == len(self.stages) - 1
                return stage, ignition, self.burnout if is_final else ignition + stage.burn_time_s
            ignition += stage.burn_time_s + stage.gap_s
        raise AssertionError

    def untailed(self, stage, since):
        """Return the acceleration of constant thrust and mass flow that gains the ideal speed."""
        q = 1 - 1 / stage.growth
        burn = stage.burn_time_s
        grid, weight = np.polynomial.legendre.leggauss(60)
        total = 0.5 * (burn - self.tail)
        middle = np.sum(weight / (1 - q * (grid + 1) * total / burn)) * total
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
        forward = heading - heading @ along * along
        return math.cos(lead) * along + math.sin(lead) * forward / np.linalg.norm(forward)

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
        legs = []
        edges = self.pieces()
        for begin, end in pairwise(edges):
            # Just inside the piece at its ends, where the thrust of the next one would begin.
            inside = 1e-9 * (end - begin)
            right_side = self.rates(0.5 * (begin + end))

            def within(t, y, right_side=right_side, low=begin + inside, high=end - inside):
                return right_side(min(max(t, low), high), y)

            legs.append(solve_ivp(within, (begin, end), state, **self.options))
            state = legs[-1].y[:, -1]

        def down(t, y):
            return height_m(y[:3]) - self.target_height

        down.terminal = True
        down.direction = -1.0
        coast = solve_ivp(
            self.rates(math.inf),
            (self.burnout, 2e4),
            state,
            events=down,
            max_step=50.0,
            **self.options,
        )
        return [*legs, coast]
