"""Whole scenes under forces: where SciPy, in the frame that turns with the Earth, has their targets
come down.

The truth of a scene gives burnout states relative to the Earth and the aim points. SciPy integrates
from there in ECEF, with centrifugal and Coriolis accelerations, its own gravity gradient (of the
potential, term by term) and exponential air, and finds the impact as an event of pyproj's height.
"""

from functools import cache

import numpy as np
import pyproj
import pytest
from repository import TEST_SCENES
from scipy.integrate import solve_ivp
from scipy.special import legendre

from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight.forces import ZonalField
from opir_core.geometry import Geodetic, geodetic_to_ecef
from opir_core.planning.plan import compile_plan
from opir_core.reading import load_scene

EXAMPLE = TEST_SCENES / "pacific_test_range.yaml"
FIELD = ZonalField()
AIR = "exponential: {density_kg_m3: 1.225, scale_height_m: 7200.0}"
BETA = {"usual": 2000.0, "own": 400.0}
OWN = f"targets[2].ballistic_coefficient_kg_m2={BETA['own']}"
SCENES = {
    "kepler": ("kepler", (), None),
    "j2": ("[j2]", ("j2",), None),
    "j2 j3 j4": ("[j2, j3, j4]", ("j2", "j3", "j4"), None),
    "j2 drag": (
        f"[j2, drag: {{ballistic_coefficient_kg_m2: {BETA['usual']}, {AIR}}}]",
        ("j2",),
        BETA,
    ),
}

to_geodetic = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


def gravity(position, zonal):
    """Return -grad of the potential -mu/r (1 - sum J_n (R/r)^n P_n(z/r)), by r and s = z/r."""
    r = np.linalg.norm(position)
    s = position[2] / r
    along_r = 1.0
    along_s = 0.0
    for name in zonal:
        n = int(name[1])
        polynomial = legendre(int(name[1]))
        strength = getattr(FIELD, name) * (FIELD.radius_m / r) ** n
        along_r -= (n + 1) * strength * polynomial(s)
        along_s -= strength * polynomial.deriv()(s)
    outward = position / r
    slope = (np.array([0.0, 0.0, 1.0]) - s * outward) / r
    return EARTH_MU_M3_S2 * (-along_r * outward / r**2 + along_s * slope / r)


def impact_ecef_m(position, velocity, aim_height_m, zonal, beta):
    turn = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])

    def rates(_, state):
        place = state[:3]
        speed = state[3:]
        pull = (
            gravity(place, zonal)
            - np.cross(turn, np.cross(turn, place))
            - 2.0 * np.cross(turn, speed)
        )
        if beta is not None:
            density = 1.225 * np.exp(-height(0.0, state) / 7200.0)
            pull = pull - density * np.linalg.norm(speed) * speed / (2.0 * beta)
        return np.concatenate([speed, pull])

    def height(_, state):
        return to_geodetic.transform(*state[:3])[2]

    def landed(_, state):
        return height(_, state) - aim_height_m

    landed.terminal = True
    landed.direction = -1
    start = np.concatenate([position, velocity])
    bound = {} if beta is None else {"max_step": 15.0}
    done = solve_ivp(
        rates, (0.0, 6000.0), start, method="DOP853", events=landed, rtol=1e-9, atol=1e-4, **bound
    )
    return done.y_events[0][0][:3], done.t_events[0][0]


@cache
def truth_of(name):
    overrides = [f"forces={SCENES[name][0]}", "outputs=[]", OWN, "targets[0].aim.height_m=120.0"]
    return compile_plan(load_scene(EXAMPLE, overrides=overrides)).targets.truth()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SCENES))
def test_every_target_comes_down_within_a_metre_of_its_aim(name):
    _, zonal, beta = SCENES[name]
    for number, target in enumerate(truth_of(name)):
        coefficient = beta and beta["own" if number == 2 else "usual"]
        burnout = target["burnout"]
        aim = target["aim"]
        states = np.array(burnout["position_ecef_m"]), np.array(burnout["velocity_ecef_m_s"])
        impact, flight_s = impact_ecef_m(*states, aim["height_m"], zonal, coefficient)
        place = Geodetic(np.radians(aim["lat_deg"]), np.radians(aim["lon_deg"]), aim["height_m"])
        assert np.linalg.norm(impact - geodetic_to_ecef(*place)) <= 1.0
        assert abs(target["burnout_s"] + flight_s - target["impact"]["time_s"]) <= 1e-3


def test_forces_matter():
    """Each force moves the burnout of each target by more than the metre that the others are held
    to.
    """
    speeds = {
        name: [np.array(t["burnout"]["velocity_ecef_m_s"]) for t in truth_of(name)]
        for name in SCENES
    }
    for forces, more_forces in (("kepler", "j2"), ("j2", "j2 drag")):
        for before, after in zip(speeds[forces], speeds[more_forces], strict=True):
            assert np.linalg.norm(before - after) > 0.05
