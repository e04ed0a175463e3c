"""Search volumes against a circular orbit in closed form, and against draws that are flown here.

Flights are integrated in plain numpy (Runge–Kutta of fourth order, point mass and J2), in inertial
axes; the Earth turns below them.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_export import search_volumes
from opir_testing import stub_estimates
from repository import EXAMPLES

import opir_core

MU = 3.986004418e14
J2 = 1.08262668355e-3
RADIUS_M = 6378137.0
SPIN = 7.292115e-5
FLATTENING = 1 / 298.257223563


def run_with(states, covariances, forces="kepler", tick_s=100.0, available_s=103.0):
    overrides = ["duration_s=11", f"forces={forces}"]
    run = opir_core.simulate(
        opir_core.load_scene(EXAMPLES / "first_light.yaml", overrides=overrides)
    )
    tracks = stub_estimates(
        len(states),
        track=np.arange(len(states)),
        tick_s=tick_s,
        available_s=available_s,
        state=states,
        state_covariance=covariances,
        probability_burning=0.0,
    )
    return evolve(run, tracks=tracks.freeze())


def acceleration(position, j2):
    x, y, z = position.T
    r = np.sqrt(x**2 + y**2 + z**2)
    bulge = 1.5 * j2 * (RADIUS_M / r) ** 2
    polar = 5.0 * z**2 / r**2
    factors = 1 + bulge * (1 - polar), 1 + bulge * (1 - polar), 1 + bulge * (3 - polar)
    return -MU / r[:, None] ** 3 * position * np.stack(factors, axis=1)


def flown(states, duration_s, j2, steps=400):
    """Return ECEF positions (n, 3) after durations (n,), s, from ECEF states (n, 6)."""
    position = states[:, :3].copy()
    velocity = states[:, 3:] + np.cross([0.0, 0.0, SPIN], position)
    step = np.asarray(duration_s)[:, None] / steps
    for _ in range(steps):
        v2 = velocity + 0.5 * step * acceleration(position, j2)
        a2 = acceleration(position + 0.5 * step * velocity, j2)
        v3 = velocity + 0.5 * step * a2
        a3 = acceleration(position + 0.5 * step * v2, j2)
        v4 = velocity + step * a3
        a4 = acceleration(position + step * v3, j2)
        slope = acceleration(position, j2) + 2 * a2 + 2 * a3 + a4
        position = position + step / 6 * (velocity + 2 * v2 + 2 * v3 + v4)
        velocity = velocity + step / 6 * slope
    turn = SPIN * np.asarray(duration_s)
    x, y, z = position.T
    return np.stack(
        [np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x, z], axis=1
    )


def site_and_axes(lat_deg, lon_deg):
    """Return the ECEF position (3,) of a site on the ellipsoid and its axes: east, north, up."""
    latitude, longitude = np.radians([lat_deg, lon_deg])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    square = FLATTENING * (2 - FLATTENING)
    normal = RADIUS_M / np.sqrt(1 - square * np.sin(latitude) ** 2)
    return normal * up * [1, 1, 1 - square], np.stack([east, np.cross(up, east), up])


def test_a_circular_orbit_rises_when_and_where_the_closed_form_says():
    radius = RADIUS_M + 800e3
    rate = np.sqrt(MU / radius**3)
    mask = np.radians(10.0)
    # Over the equator, eastward: it rises where the site sees it at the mask, `arc` before it.
    arc = np.arccos(RADIUS_M * np.cos(mask) / radius) - mask
    start = arc + 0.5
    spread = np.diag([200.0, 300.0, 400.0, 3.0, 4.0, 5.0]) ** 2
    speed = radius * (rate - SPIN)
    run = run_with([[radius, 0.0, 0.0, 0.0, speed, 0.0]], [spread])
    (cue,) = search_volumes(run, lat_deg=0.0, lon_deg=np.degrees(start), mask_deg=10.0)
    volume = cue.volume
    flight_s = 0.5 / (rate - SPIN)
    assert cue.reason == "rises"
    assert volume.time_s == pytest.approx(100.0 + flight_s, abs=2e-3)
    assert volume.react_s == pytest.approx(flight_s - 3.0, abs=2e-3)
    assert volume.azimuth_deg == pytest.approx(270.0, abs=1e-9)
    assert volume.elevation_deg == pytest.approx(10.0, abs=1e-4)
    assert volume.range_m == pytest.approx(radius * np.sin(arc) / np.cos(mask), abs=20.0)
    # Across the orbit a circular orbit swings as a pendulum (Clohessy and Wiltshire, 1960).
    north = np.hypot(400.0 * np.cos(rate * flight_s), 5.0 / rate * np.sin(rate * flight_s))
    assert np.sqrt(volume.covariance_m2[1][1]) == pytest.approx(north, rel=1e-4)
    # Seen from the west, north lies across, along the horizon, and independent of the rest.
    across = north / volume.range_m
    assert np.radians(volume.azimuth_sigma_deg) == pytest.approx(across / np.cos(mask), rel=1e-4)
    rise = np.radians(volume.elevation_sigma_deg)
    assert volume.solid_angle_sr == pytest.approx(np.pi * 5.99146 * across * rise, rel=1e-4)
    axes = np.sqrt(np.linalg.eigvalsh(volume.covariance_m2))
    ellipsoid = 4 / 3 * np.pi * 7.81473**1.5 * np.prod(axes)
    assert volume.ellipsoid_m3 == pytest.approx(ellipsoid, rel=1e-5)


#: Targets, and draws of each.
TARGETS = 30
DRAWS = 40
SITE = (9.4, 167.5)


def drawn_targets(random):
    """Return states (n, 6) at burnout, 1 500 to 3 000 km from the site and bound for it, and their
    covariances, with correlation."""
    site, axes = site_and_axes(*SITE)
    up = site / np.linalg.norm(site)
    bearing, arc, slope, speed = random.uniform(
        [[0.0], [0.24], [0.6], [4200.0]], [[2 * np.pi], [0.47], [0.8], [5200.0]], (4, TARGETS)
    )[:, :, None]
    aside = np.cross(up, np.sin(bearing) * axes[0] + np.cos(bearing) * axes[1])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    place = np.cos(arc) * up + np.sin(arc) * aside
    towards = np.sin(arc) * up - np.cos(arc) * aside
    velocity = speed * (np.cos(slope) * towards + np.sin(slope) * place)
    states = np.concatenate([place * (RADIUS_M + 200e3), velocity], axis=1)
    sizes = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02]) * random.uniform(300, 1500, (TARGETS, 1, 1))
    roots = random.normal(size=(TARGETS, 6, 6)) * sizes.transpose(0, 2, 1) / np.sqrt(6)
    return states, roots


@pytest.fixture(scope="module", params=["kepler", "[j2]"])
def drawn(request):
    """Return cues, and where draws of their targets are at their times (n, k, 3), in local axes."""
    random = np.random.default_rng(20260401)
    states, roots = drawn_targets(random)
    run = run_with(states, roots @ roots.transpose(0, 2, 1), request.param)
    cues = search_volumes(run, lat_deg=SITE[0], lon_deg=SITE[1])
    j2 = J2 if request.param == "[j2]" else 0.0
    site, axes = site_and_axes(*SITE)
    noise = random.normal(size=(TARGETS, DRAWS, 6))
    noise[:, 0] = 0.0  # the estimate itself
    draws = states[:, None] + np.einsum("nij,nkj->nki", roots, noise)
    times = np.array([cue.volume.time_s for cue in cues])
    flights_s = np.repeat(times - 100.0, DRAWS)
    places = flown(draws.reshape(-1, 6), flights_s, j2).reshape(TARGETS, DRAWS, 3)

    def elevations_before(seconds):
        offset = (flown(states, times - 100.0 - seconds, j2) - site) @ axes.T
        return np.degrees(np.arcsin(offset[:, 2] / np.linalg.norm(offset, axis=1)))

    return cues, (places - site) @ axes.T, elevations_before


def test_the_mean_is_where_an_own_integration_has_it(drawn):
    cues, offsets, _ = drawn
    for cue, (east, north, up) in zip(cues, offsets[:, 0], strict=True):
        volume = cue.volume
        assert volume.range_m == pytest.approx(np.linalg.norm([east, north, up]), abs=1.0)
        azimuth = np.degrees(np.arctan2(east, north)) % 360.0
        assert volume.azimuth_deg == pytest.approx(azimuth, abs=1e-4)
        assert volume.elevation_deg == pytest.approx(
            np.degrees(np.arctan2(up, np.hypot(east, north))), abs=1e-4
        )


def test_targets_rise_at_the_time_and_not_before(drawn):
    cues, _, elevations_before = drawn
    assert {cue.reason for cue in cues} <= {"rises", "in view"}
    rises = np.array([cue.reason == "rises" for cue in cues])
    assert rises.sum() > TARGETS // 2
    assert elevations_before(0.0)[rises] == pytest.approx(5.0, abs=1e-3)
    wait_s = np.array([cue.volume.react_s for cue in cues])
    for share in np.linspace(0.02, 1.0, 12):
        assert (elevations_before(share * wait_s)[rises] < 5.0).all()
    assert (wait_s[~rises] == 0.0).all()


def test_volumes_hold_95_percent_of_draws(drawn):
    """Of 30 · 39 draws a volume of 95 % holds 95 % to 0.64 % (binomial, one sigma): 92 and 98 % are
    4.7 sigma away, 3e-6 by chance. Radii that are wrong by 15 % or more are outside.
    """
    cues, offsets, _ = drawn
    inside = {"ellipsoid": [], "ellipse": [], "range": [], "azimuth": [], "elevation": []}
    for cue, rows in zip(cues, offsets[:, 1:], strict=True):
        volume = cue.volume
        mean = np.linalg.norm(rows, axis=1)
        azimuth = np.degrees(np.arctan2(rows[:, 0], rows[:, 1])) - volume.azimuth_deg
        aside = (azimuth + 180.0) % 360.0 - 180.0
        rise = np.degrees(np.arcsin(rows[:, 2] / mean)) - volume.elevation_deg
        across = aside * np.cos(np.radians(volume.elevation_deg))
        turn = np.radians(volume.orientation_deg)
        major = np.sin(turn) * across + np.cos(turn) * rise
        minor = np.cos(turn) * across - np.sin(turn) * rise
        inside["ellipse"] += list(
            np.hypot(major / volume.semi_major_deg, minor / volume.semi_minor_deg) <= 1.0
        )
        inside["azimuth"] += list(abs(aside) <= volume.azimuth_95_deg)
        inside["elevation"] += list(abs(rise) <= volume.elevation_95_deg)
        inside["range"] += list(abs(mean - volume.range_m) <= 0.5 * volume.range_depth_m)
        site, axes = site_and_axes(*SITE)
        off = rows - axes @ (np.array(volume.position_ecef_m) - site)
        squares = np.einsum("ki,ij,kj->k", off, np.linalg.inv(volume.covariance_m2), off)
        inside["ellipsoid"] += list(squares <= 7.81473)
    shares = {name: np.mean(rows) for name, rows in inside.items()}
    assert all(0.92 <= share <= 0.98 for share in shares.values()), shares
