"""Bodies that the air heats, in a whole scene, against a script of its own: Sutton and Graves' law
(NASA TR R-376, 1971), laminar and turbulent flow along a plate (Tauber, Menees and Adelman, 1987),
the standard atmosphere to 71 km, Stefan and Boltzmann's law solved by bisection, Planck's law
integrated by SciPy. Laws, constants and shapes are those that opir documents: the script shows that
they are computed right, not that bodies are so bright.
"""

import math

import numpy as np
import pytest
from opir_photons.radiometry import stagnation_flux_w_m2
from opir_photons.radiometry.heating import HeatedBodies
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import opir_core as opir
from opir_core.geometry import ecef_to_geodetic
from opir_core.planning import Looks
from opir_core.plugin import Band, Exposures
from opir_core.simulation import ProbabilityInterpolant

EPOCH = "2026-03-01T12:00:00Z"
BANDS = {"SWIR": (2.5, 3.0), "MWIR": (4.0, 5.0)}
SIGMA = 5.670374419e-8


def air_kg_m3(height_m):
    """The 1976 standard to 71 km, from its table of layers."""
    level = 6356766.0 * height_m / (6356766.0 + height_m)
    layers = [
        (0.0, 288.15, -0.0065, 101325.0),
        (11e3, 216.65, 0.0, 22632.06),
        (20e3, 216.65, 0.001, 5474.889),
        (32e3, 228.65, 0.0028, 868.0187),
        (47e3, 270.65, 0.0, 110.9063),
        (51e3, 270.65, -0.0028, 66.93887),
        (71e3, 214.65, -0.002, 3.956420),
    ]
    base, warm, lapse, pressure = [layer for layer in layers if layer[0] <= level][-1]
    kelvin = warm + lapse * (level - base)
    pull = 9.80665 * 0.0289644 / 8.31432
    if lapse:
        pascal = pressure * (warm / kelvin) ** (pull / lapse)
    else:
        pascal = pressure * math.exp(-pull * (level - base) / warm)
    return pascal * 0.0289644 / (8.31432 * kelvin)


def surface_k(flux, speed, emissivity=0.9, cold=300.0):
    """Temperature at which a wall radiates what it gets of a cold wall's flux."""
    enthalpy = 1100.0 * 220.0 + 0.5 * speed**2

    def balance(kelvin):
        return emissivity * SIGMA * (kelvin**4 - cold**4) - flux * (
            1.0 - 1100.0 * kelvin / enthalpy
        )

    # A wall of the air's temperature gets nothing: below Mach 4 it may stay as cold as without air.
    warms = balance(cold) < 0.0
    return min(brentq(balance, cold, 3e4, xtol=1e-9), 3900.0) if warms else cold


def radiance(kelvin, low, high):
    def spectral(um):
        return 1.191042972e8 / um**5 / math.expm1(14387.76877 / (um * kelvin))

    return quad(spectral, low, high, epsrel=1e-10)[0]


def plate_w_m2(density, speed, length, slope_deg=10.0):
    slope = math.radians(slope_deg)
    shape = math.sqrt(math.cos(slope) / length) * math.sin(slope)
    laminar = 2.53e-5 * shape * math.sqrt(density) * speed**3.2
    fast = speed**3.7 if speed > 3962.0 else 3962.0**0.33 * speed**3.37
    bent = math.cos(slope) ** 2.08 * math.sin(slope) ** 1.6
    turbulent = 2.2e-5 * bent * density**0.8 * length**-0.2 * fast
    reynolds = density * speed * length / 1.45e-5
    share = reynolds**2 / (reynolds**2 + 1e12)
    free = 0.5 * density * speed**3 * math.sin(slope)
    return min(laminar + share * max(turbulent - laminar, 0.0), free)


def nose_w_m2(density, speed, radius):
    return min(1.7415e-4 * math.sqrt(density / radius) * speed**3, 0.5 * density * speed**3)


def body_w_sr(speed, band, *parts, emissivity=0.9, shown_m2=4.0):
    """Return the light of a body of an area, as seen, with parts of an area, m², that get a heat
    flux.
    """
    cold = radiance(300.0, *BANDS[band])
    excess = sum(
        0.25 * area * (radiance(surface_k(flux, speed, emissivity), *BANDS[band]) - cold)
        for area, flux in parts
    )
    return emissivity * (shown_m2 * cold + excess)


def glider_w_sr(density, speed, band):
    """A nose of 3 cm, and 8 m² each of a windward side and of a lee side that gets a tenth."""
    flux = plate_w_m2(density, speed, 2.0)
    nose = math.pi * 0.03**2, nose_w_m2(density, speed, 0.03)
    return body_w_sr(speed, band, nose, (8.0, flux), (8.0, 0.1 * flux))


def cone_w_sr(density, speed, band):
    """A nose of 5 cm, and 16 m² of a flank."""
    nose = math.pi * 0.05**2, nose_w_m2(density, speed, 0.05)
    return body_w_sr(speed, band, nose, (16.0, plate_w_m2(density, speed, 1.0)))


def stage_w_sr(density, speed, band, since_s):
    """A nose of 50 cm, 24 m² each of a windward and a lee side, and a nozzle of 0.96 m²."""
    flux = plate_w_m2(density, speed, 3.0, slope_deg=40.0)
    nose = math.pi * 0.5**2, nose_w_m2(density, speed, 0.5)
    sides = (24.0, flux), (24.0, 0.1 * flux)
    body = body_w_sr(speed, band, nose, *sides, emissivity=0.8, shown_m2=12.0)
    return body + nozzle_w_sr(0.96, since_s, band)


def nozzle_w_sr(area_m2, since_s, band):
    """What a nozzle of 1 300 K and 12 kJ/(m² K) radiates more than at 300 K, from both of its
    sides cooled for a time.
    """
    cooled = solve_ivp(
        lambda _, kelvin: -2.0 * 0.8 * SIGMA * kelvin**4 / 12e3,
        (0.0, since_s),
        [1300.0],
        rtol=1e-10,
    )
    edges = BANDS[band]
    excess = radiance(cooled.y[0, -1], *edges) - radiance(300.0, *edges)
    return 0.8 * area_m2 * max(excess, 0.0)


def plan_of(target, follows=False, **changes):
    sensor = {"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 160.0, "scan_period_ms": 1000}
    scene = {
        "scene": "hot bodies",
        "epoch": EPOCH,
        "duration_s": 4000,
        "seed": 4,
        "sensors": [sensor | ({"follows_bodies": True} if follows else {})],
        "targets": [target],
        "detection": {"model": "snr"},
        "outputs": [],
    }
    return opir.compile_plan(opir.scene_from_mapping(scene | changes))


def seen_w_sr(plan, time_s, row=0):
    """Return opir's intensities (2, n), heights, m, and speeds, m/s, of a target at times."""
    target = np.full(len(time_s), row, dtype=np.int32)
    place_m = plan.targets.position_ecef_m(target, time_s)
    aside_m = place_m + np.array([3e7, 0.0, 1e7])
    ones = np.ones(len(time_s))
    sensor = np.zeros_like(target)
    looks = Exposures(
        time_s, time_s, sensor, sensor, target, 3.2e7 * ones, 0.5 * ones, place_m, aside_m
    )
    height_m = ecef_to_geodetic(place_m).height_m
    environment = plan.detection.environment
    # At night: sunlight is another test's.
    light = environment.intensities_w_sr((0, 1), looks, height_m, ones)
    step_m = plan.targets.position_ecef_m(target, time_s + 0.02) - plan.targets.position_ecef_m(
        target, time_s - 0.02
    )
    return light, height_m, np.linalg.norm(step_m, axis=1) / 0.04


GLIDER = {
    "id": "G",
    "type": "HGV",
    "launch": {"lat_deg": 20.0, "lon_deg": 140.0, "time_s": 10.0},
    "aim": {"lat_deg": 45.0, "lon_deg": -140.0},
    "signature": {"model": "plume", "body_albedo": 0.0},
}


def test_a_glider_radiates_what_an_own_script_gives():
    plan = plan_of(GLIDER)
    burnout_s, end_s = float(plan.targets.burnout_s[0]), float(plan.targets.end_s[0])
    time_s = np.linspace(burnout_s + 1.0, end_s - 1.0, 200)
    light, height_m, speed_m_s = seen_w_sr(plan, time_s)
    expected = [
        [
            glider_w_sr(air_kg_m3(height), speed, band)
            for height, speed in zip(height_m, speed_m_s, strict=True)
        ]
        for band in BANDS
    ]
    assert speed_m_s.max() > 6000.0
    assert speed_m_s.min() < 1550.0
    assert light == pytest.approx(np.array(expected), rel=0.01)


def test_the_light_falls_with_the_speed_of_the_glide():
    """The ratio of SWIR from the start of a long glide to its end. Height is that of equilibrium
    glide in an exponential atmosphere (Eggers, Allen and Neice, NACA TN 4046, 1957): 7100 m times
    the logarithm of v²/(v_c² - v²).
    """
    plan = plan_of(GLIDER)
    burnout_s, end_s = float(plan.targets.burnout_s[0]), float(plan.targets.end_s[0])
    time_s = np.linspace(burnout_s + 1.0, end_s - 100.0, 2000)
    light, height_m, speed_m_s = seen_w_sr(plan, time_s)
    first, last = (int(np.argmin(np.abs(speed_m_s - speed))) for speed in (6400.0, 1550.0))
    fast, slow = float(speed_m_s[first]), float(speed_m_s[last])
    start_m = float(height_m[first])
    circular = math.sqrt(3.986004418e14 / (6.378137e6 + start_m))
    lifts = [speed**2 / (circular**2 - speed**2) for speed in (fast, slow)]
    end_m = start_m + 7100.0 * math.log(lifts[1] / lifts[0])
    ratio = glider_w_sr(air_kg_m3(start_m), fast, "SWIR") / glider_w_sr(
        air_kg_m3(end_m), slow, "SWIR"
    )
    assert ratio > 10.0
    assert light[0, first] / light[0, last] == pytest.approx(ratio, rel=0.05)


@pytest.mark.parametrize("forces", ["kepler", ["j2", "drag"]])
def test_a_body_that_comes_down_radiates_what_an_own_script_gives(forces):
    target = {
        "id": "R",
        "type": "ICBM",
        "launch": {"lat_deg": 20.0, "lon_deg": 140.0, "time_s": 10.0},
        "aim": {"lat_deg": 45.0, "lon_deg": -140.0},
        "signature": {"model": "plume", "body_albedo": 0.0},
    }
    plan = plan_of(target, follows=True, forces=forces)
    end_s = float(plan.targets.end_s[0])
    time_s = end_s - np.linspace(0.1, 60.0, 60)
    light, height_m, speed_m_s = seen_w_sr(plan, time_s)
    rows = np.flatnonzero(height_m < 70e3)
    expected = [
        [cone_w_sr(air_kg_m3(height_m[row]), speed_m_s[row], band) for row in rows]
        for band in BANDS
    ]
    assert len(rows) > 10
    assert light[:, rows] == pytest.approx(np.array(expected), rel=0.01)


def test_from_7_to_1_5_km_s_the_light_falls_as_an_own_script_gives():
    """Of a glider whose equilibrium is at 59 km at 5.4 km/s, where the class begins a glide of 5 000
    km (Eggers, Allen and Neice, 1957).
    """
    circular = math.sqrt(3.986004418e14 / 6.438e6)
    lifts = [speed**2 / (circular**2 - speed**2) for speed in (5400.0, 7000.0, 1500.0)]
    heights = [59e3 + 7100.0 * math.log(lift / lifts[0]) for lift in lifts[1:]]
    densities = [air_kg_m3(height) for height in heights]
    glider = HeatedBodies.of(["HGV"], np.array([4.0]), np.array([0.9]), np.array([300.0]))
    light = [
        glider.excess_w_sr(
            [Band("SWIR", *BANDS["SWIR"])],
            np.zeros(1, dtype=np.int32),
            np.array([density]),
            np.array([speed]),
        )[0, 0]
        for density, speed in zip(densities, (7000.0, 1500.0), strict=True)
    ]
    expected = [
        glider_w_sr(density, speed, "SWIR")
        for density, speed in zip(densities, (7e3, 1.5e3), strict=True)
    ]
    ratio = expected[0] / expected[1]
    assert ratio > 20.0
    assert light[0] / light[1] == pytest.approx(ratio, rel=0.01)


def test_a_nozzle_cools_after_the_burn_as_an_integration_gives():
    """Above the air, to which the next test belongs."""
    target = {
        "id": "R",
        "type": "ICBM",
        "launch": {"lat_deg": 20.0, "lon_deg": 140.0, "time_s": 10.0},
        "aim": {"lat_deg": 45.0, "lon_deg": -140.0},
        "signature": {"model": "plume", "body_albedo": 0.0},
    }
    plan = plan_of(target, follows=True)
    since_s = np.array([20.0, 40.0, 90.0, 300.0, 900.0])
    light, height_m, _ = seen_w_sr(plan, plan.targets.burnout_s[0] + since_s)
    assert height_m.min() > 200e3
    expected = [
        [
            0.9 * 4.0 * radiance(300.0, *BANDS[band]) + nozzle_w_sr(0.5, after_s, band)
            for after_s in since_s
        ]
        for band in BANDS
    ]
    assert light == pytest.approx(np.array(expected), rel=1e-4)


def test_a_spent_stage_radiates_what_an_own_script_gives():
    block = {"id": "S", "model": "spent_stages", "launch": "G", "albedo": 0.0}
    plan = plan_of(GLIDER, sources=[block])
    row = plan.targets.ids.index("S-2")
    begin_s, end_s = plan.targets.ignition_s[row], plan.targets.end_s[row]
    assert begin_s == pytest.approx(plan.targets.burnout_s[0])
    time_s = begin_s + np.linspace(0.0, 1.0, 60)[1:-1] * (end_s - begin_s)
    light, height_m, speed_m_s = seen_w_sr(plan, time_s, row)
    low = np.flatnonzero(height_m < 70e3)
    assert len(low) > 20
    assert speed_m_s[low].max() > 6000.0
    assert speed_m_s[low].min() < 1000.0
    expected = [
        [
            stage_w_sr(air_kg_m3(height_m[place]), speed_m_s[place], band, time_s[place] - begin_s)
            for place in low
        ]
        for band in BANDS
    ]
    assert light[:, low] == pytest.approx(np.array(expected), rel=0.01)


def test_a_spent_stage_falls_as_an_integration_gives():
    """Drag of the standard atmosphere, that turns with the Earth, and gravity with J2, from the
    place and the velocity of the launch where it burns out.
    """
    block = {"id": "S", "model": "spent_stages", "launch": "G"}
    plan = plan_of(GLIDER, follows=True, sources=[block])
    row = plan.targets.ids.index("S-2")
    begin_s = plan.targets.burnout_s[0]
    launch = np.zeros(4, dtype=np.int32)
    back_s = 0.2 * np.arange(4.0)
    path = plan.targets.position_ecef_m(launch, begin_s - back_s)
    # A parabola and its third difference.
    velocity = (11.0 * path[0] - 18.0 * path[1] + 9.0 * path[2] - 2.0 * path[3]) / (6.0 * 0.2)
    spin = np.array([0.0, 0.0, 7.292115e-5])

    def rates(_, state):
        place, speed = state[:3], state[3:]
        radius = np.linalg.norm(place)
        z = (place[2] / radius) ** 2
        flat = 1.5 * 1.08262668e-3 * (6378137.0 / radius) ** 2
        bent = place * (1.0 - flat * (5.0 * z - np.array([1.0, 1.0, 3.0])))
        gravity = -3.986004418e14 / radius**3 * bent
        height = ecef_to_geodetic(place[None]).height_m[0]
        drag = -0.5 * air_kg_m3(height) / 150.0 * np.linalg.norm(speed) * speed
        turning = -2.0 * np.cross(spin, speed) - np.cross(spin, np.cross(spin, place))
        return np.concatenate([speed, gravity + drag + turning])

    start = np.concatenate([path[0], velocity])
    flown = solve_ivp(rates, (0.0, 80.0), start, rtol=1e-9, atol=1e-6, dense_output=True)
    after_s = np.array([0.0, 20.0, 40.0, 80.0])
    rows = np.full(4, row, dtype=np.int32)
    place = plan.targets.position_ecef_m(rows, begin_s + after_s)
    miss_m = np.linalg.norm(place - flown.sol(after_s)[:3].T, axis=1)
    assert miss_m[0] < 0.1
    assert np.all(miss_m < 1.0 + 2.0 * after_s)


def test_stagnation_flux_is_that_of_another_law_within_a_fifth():
    """R. W. Detra and H. Hidalgo, ARS Journal 31 (1961) 318: 1.103e8 W/m² √(ρ/ρ₀/R)
    (v/7925 m/s)^3.15.
    """
    for density, speed in ((1e-4, 7000.0), (1e-3, 6000.0), (1e-2, 4000.0)):
        other = 1.103e8 * math.sqrt(density / 1.225 / 0.3) * (speed / 7925.0) ** 3.15
        assert float(stagnation_flux_w_m2(density, speed, 0.3)) == pytest.approx(other, rel=0.2)


def test_without_light_no_sensor_looks_at_a_glide():
    plan = plan_of(
        {name: GLIDER[name] for name in ("id", "type", "launch", "aim")}, detection="constant"
    )
    assert plan.targets.end_s[0] == plan.targets.burnout_s[0]


def test_every_sensor_that_measures_light_looks_at_a_glide():
    plan = plan_of(GLIDER)
    assert plan.targets.glow_end_s[0] == plan.targets.end_s[0] > plan.targets.burnout_s[0] + 1000.0
    assert plan.pairs.until_s[0] == plan.targets.end_s[0]


def test_probabilities_between_knots_are_those_of_looks_during_re_entry():
    """Light rises by orders of magnitude in seconds, after half an hour without any."""
    target = {
        "id": "R",
        "type": "ICBM",
        "launch": {"lat_deg": 20.0, "lon_deg": 140.0, "time_s": 10.0},
        "aim": {"lat_deg": 45.0, "lon_deg": -140.0},
    }
    plan = plan_of(target, follows=True, forces=["j2", "drag"])
    model = plan.detection
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    interpolant = ProbabilityInterpolant.of(
        plan.look_geometry(), model, model.probability_tolerance
    )
    exact = model.probability(plan.look_geometry().exposures(looks.pair, looks.scan))
    late = looks.scan > looks.scan.max() - 200
    assert exact[late].min() < 0.01 < 0.99 < exact[late].max()
    error = np.abs(interpolant.over(looks).probability() - exact)
    assert error.max() < 2.0 * model.probability_tolerance
