"""Kepler orbits in ECEF against fifty digits: Kepler's equation by Newton's method, rotations, the
turning Earth.
"""

import math

import mpmath
import numpy as np
from hypothesis import example, given, strategies as st

from examples import examples
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.orbits import Elements
from opir_core.orbits.elements import mean_anomaly_rad
from opir_core.orbits.orbit_models import TwoBodyMotion

angles = st.floats(-6.3, 6.3)


@st.composite
def orbits(draw):
    eccentricity = draw(st.one_of(st.floats(0.0, 0.9), st.sampled_from([0.0, 1e-300, 1e-16, 1e-8])))
    return Elements(
        semi_major_axis_m=draw(st.floats(6.6e6, 4.3e7)) / (1.0 - eccentricity),
        eccentricity=eccentricity,
        inclination_rad=draw(
            st.one_of(st.floats(0.0, math.pi), st.sampled_from([0.0, math.pi, math.pi / 2]))
        ),
        node_longitude_rad=draw(angles),
        argument_of_perigee_rad=draw(angles),
        mean_anomaly_rad=draw(angles),
    )


def eccentric_anomaly(mean, eccentricity):
    reduced = mean - 2 * mpmath.pi * mpmath.nint(mean / (2 * mpmath.pi))
    result = reduced + eccentricity * mpmath.sign(reduced)
    for _ in range(200):
        step = (result - eccentricity * mpmath.sin(result) - reduced) / (
            1 - eccentricity * mpmath.cos(result)
        )
        result -= step
        if abs(step) < mpmath.mpf(10) ** -45:
            return result
    raise AssertionError("Newton's method has not converged")


def position_ecef(elements, time_s):
    axis = mpmath.mpf(elements.semi_major_axis_m)
    eccentricity = mpmath.mpf(elements.eccentricity)
    rate = mpmath.sqrt(mpmath.mpf(EARTH_MU_M3_S2) / axis**3)
    anomaly = eccentric_anomaly(
        mpmath.mpf(elements.mean_anomaly_rad) + rate * mpmath.mpf(time_s), eccentricity
    )
    forward = axis * (mpmath.cos(anomaly) - eccentricity)
    across = axis * mpmath.sqrt(1 - eccentricity**2) * mpmath.sin(anomaly)
    cosine = mpmath.cos(elements.argument_of_perigee_rad)
    sine = mpmath.sin(elements.argument_of_perigee_rad)
    x = cosine * forward - sine * across
    y = sine * forward + cosine * across
    y, z = y * mpmath.cos(elements.inclination_rad), y * mpmath.sin(elements.inclination_rad)
    turn = mpmath.mpf(elements.node_longitude_rad) - mpmath.mpf(EARTH_ROTATION_RAD_S) * mpmath.mpf(
        time_s
    )
    return [
        mpmath.cos(turn) * x - mpmath.sin(turn) * y,
        mpmath.sin(turn) * x + mpmath.cos(turn) * y,
        z,
    ]


@examples(150)
@given(orbits(), st.one_of(st.floats(-1e6, 1e6), st.just(0.0)))
@example(
    Elements(
        semi_major_axis_m=2.6562e7,
        eccentricity=0.74,
        inclination_rad=1.107,
        node_longitude_rad=0.0,
        argument_of_perigee_rad=1.5 * math.pi,
        mean_anomaly_rad=0.0,
    ),
    86_164.0,
)
def test_positions(elements, time_s):
    result = TwoBodyMotion(elements).position_ecef_m(np.array([time_s]))[0]
    with mpmath.workdps(50):
        reference = position_ecef(elements, time_s)
        miss = float(
            mpmath.sqrt(
                sum((mpmath.mpf(float(a)) - b) ** 2 for a, b in zip(result, reference, strict=True))
            )
        )
    # What the rounding of each input to a double does: of the angles, and of the axis and time
    # through the mean motion.
    turns = 1.0 + elements.mean_motion_rad_s * abs(time_s)
    fastest = math.sqrt((1.0 + elements.eccentricity) / (1.0 - elements.eccentricity)) / (
        1.0 - elements.eccentricity
    )
    scale_m = elements.semi_major_axis_m * fastest * turns + elements.apogee_radius_m * 7.0
    assert miss <= 10.0 * 2.2e-16 * scale_m


@examples(100)
@given(st.floats(-7.0, 7.0), st.floats(0.0, 0.95))
def test_mean_anomaly(true_rad, eccentricity):
    result = mean_anomaly_rad(true_rad, eccentricity)
    with mpmath.workdps(50):
        e = mpmath.mpf(eccentricity)
        half = mpmath.mpf(true_rad) / 2
        anomaly = 2 * mpmath.atan2(
            mpmath.sqrt(1 - e) * mpmath.sin(half), mpmath.sqrt(1 + e) * mpmath.cos(half)
        )
        miss = result - (anomaly - e * mpmath.sin(anomaly))
        astray = abs(float(miss - 2 * mpmath.pi * mpmath.nint(miss / (2 * mpmath.pi))))
    assert astray <= 3e-15
    assert abs(result) <= math.pi
