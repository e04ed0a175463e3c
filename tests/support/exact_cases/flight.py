"""References of flight and orbits: two-body arcs in 56 digits, boosts and forces integrated in
extended precision.
"""

import mpmath as mp
import numpy as np

import opir_core.flight as flight
import opir_core.orbits as orbits
from exact_cases import draws
from exact_cases.geometry import OMEGA, A, fixed, geodetic
from exact_cases.integrated import boost_states, propagated
from exact_cases.measure import Bound, Case, less, norm, times
from exact_cases.two_body import exact_end
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.geometry import Geodetic, geodesic_direct, geodetic_to_ecef

MU = mp.mpf(EARTH_MU_M3_S2)


def unit(vectors):
    return vectors / np.sqrt((vectors**2).sum(axis=1, keepdims=True))


def arcs(rng, n):
    """Return states and durations of arcs: ellipses, hyperbolas, straight lines; seconds to ten
    years.
    """
    position = draws.positions(rng, n, 6.4e6, 4e8)
    circular = np.sqrt(EARTH_MU_M3_S2 / np.sqrt((position**2).sum(axis=1)))
    direction = draws.directions(rng, n)
    along = rng.random(n) < 0.1
    direction[along] = unit(position[along])
    speed = circular * draws.log_uniform(rng, n, 1e-3, 5.0, (np.sqrt(2.0), 1.0))
    duration = draws.log_uniform(rng, n, 1e-3, 3e8, (0.0, 1e-300)) * rng.choice([-1.0, 1.0], n)
    return position, direction * speed[:, None], duration


def two_body(position, velocity, duration):
    return exact_end([*position, *velocity, duration, MU])


def falls(rng, n):
    """Return states of flights that come down: burnouts of all speeds and angles, and a height."""
    position = draws.positions(rng, n, 6.45e6, 7.0e6)
    up = unit(position)
    level = np.cross(up, draws.directions(rng, n))
    size = np.sqrt((level**2).sum(axis=1, keepdims=True))
    level = np.where(size > 0.1, level / np.maximum(size, 1e-300), np.cross(up, [0.6, 0.48, 0.64]))
    angle = draws.uniform(rng, n, -1.5, 0.5 * np.pi, (0.02, 0.3))
    speed = draws.log_uniform(rng, n, 1.0, 7.4e3)
    velocity = speed[:, None] * (np.sin(angle)[:, None] * up + np.cos(angle)[:, None] * level)
    return position, velocity, rng.choice([0.0, 0.0, 1e3, -400.0], n)


def kepler_impacts(rng, n):
    """Return how far the heights of impacts are from those asked for, over the bound of the
    docstring and rounding.
    """
    columns = falls(rng, n)
    duration, point = flight.kepler_impact(*columns)
    miss = np.zeros(n)
    bound = np.ones(n)
    for row in range(n):
        if not np.isfinite(duration[row]):
            continue
        end = [mp.mpf(float(v)) for v in point[row]]
        start = [[mp.mpf(float(v)) for v in column[row]] for column in columns[:2]]
        arrived_at, speed = two_body(*start, mp.mpf(float(duration[row])))
        miss[row] = float(
            abs(geodetic(end)[2] - mp.mpf(float(columns[2][row]))) + norm(less(arrived_at, end))
        )
        bound[row] = 1e-6 + float(norm(speed) * duration[row]) * 2.0**-50
    return columns, miss, bound


def launches(rng, n):
    """Return flights of all profiles: launch and aim, ignition, profiles, and the `Aim`."""
    profiles = [
        flight.boost_profiles()[name] for name in rng.choice(sorted(flight.boost_profiles()), n)
    ]
    latitude = draws.latitudes(rng, n)
    longitude = draws.angles(rng, n)
    longitude = np.remainder(longitude + np.pi, 2.0 * np.pi) - np.pi
    shortest, longest = (
        np.array([getattr(p, f"{end}_range_m") for p in profiles]) for end in ("minimum", "maximum")
    )
    reach = shortest + (longest - shortest) * rng.uniform(0.01, 0.99, n)
    place = geodesic_direct(latitude, longitude, rng.uniform(0.0, 2.0 * np.pi, n), reach)
    launch = Geodetic(latitude, longitude, rng.choice([0.0, -400.0, 3000.0], n))
    goal = Geodetic(*place, rng.choice([0.0, 2000.0], n))
    ignition = draws.log_uniform(rng, n, 1e-6, 1e7, (0.0,))
    return launch, goal, ignition, profiles, flight.aim(launch, goal, ignition, profiles)


def aims(rng, n):
    """Return the distances of exactly flown impacts from aim points, over the tolerance of 1 cm."""
    launch, goal, ignition, profiles, result = launches(rng, n)
    burn = np.array([profile.burn_time_s for profile in profiles])
    place, velocity = boost_states(
        launch,
        result.azimuth_rad,
        result.burnout_speed_m_s,
        result.burnout_flight_path_angle_rad,
        profiles,
        burn,
    )
    expected = geodetic_to_ecef(*goal)
    miss = np.zeros(n)
    for row in range(n):
        start, speed = ([mp.mpf(str(v)) for v in column[row]] for column in (place, velocity))
        speed = [speed[0] - OMEGA * start[1], speed[1] + OMEGA * start[0], speed[2]]
        duration = mp.mpf(float(result.impact_s[row])) - mp.mpf(float(result.burnout_s[row]))
        end = fixed(two_body(start, speed, duration)[0], duration)
        miss[row] = float(norm(less(end, [mp.mpf(float(v)) for v in expected[row]])))
    # The impact's time is a scene time: its own rounding moves the impact along the path.
    rounding = 8e3 * np.spacing(result.impact_s)
    return (*launch, *goal, ignition), miss, 0.01 + rounding


def boosts(rng, n):
    """Return the errors of boost ephemerides at drawn times, over their tolerances."""
    launch, _, ignition, profiles, result = launches(rng, n)
    tolerance = float(10.0 ** rng.uniform(-5.0, 0.0))
    ephemeris = flight.boost_ephemeris(result.path, tolerance)
    share = draws.uniform(rng, n, 0.0, 1.0, (0.0, 1.0, 1e-12))
    time_s = result.path.ignition_s + share * (result.path.burnout_s - result.path.ignition_s)
    time_s = np.minimum(time_s, result.path.burnout_s)
    place, _ = boost_states(
        launch,
        result.azimuth_rad,
        result.burnout_speed_m_s,
        result.burnout_flight_path_angle_rad,
        profiles,
        np.asarray(time_s, np.longdouble) - result.path.ignition_s,
    )
    miss = np.sqrt(((ephemeris.position_m(np.arange(n), time_s) - place) ** 2).sum(axis=1)).astype(
        float
    )
    return (*launch, ignition, time_s), miss, np.full(n, tolerance) + 8e3 * np.spacing(time_s)


def coasts(rng, n):
    """Return the errors of ephemerides of free flight at drawn times, over their tolerances."""
    _, _, ignition, _, result = launches(rng, n)
    tolerance = float(10.0 ** rng.uniform(-4.0, 0.0))
    ephemeris = flight.coast_ephemeris(result, tolerance)
    time_s = result.burnout_s + draws.uniform(rng, n, 0.0, 1.0, (0.0, 1.0)) * (
        result.impact_s - result.burnout_s
    )
    time_s = np.minimum(time_s, result.impact_s)
    at = ephemeris.position_m(np.arange(n), time_s)
    miss = np.zeros(n)
    for row in range(n):
        start, speed = (
            [mp.mpf(float(v)) for v in column[row]]
            for column in (result.burnout_position_eci_m, result.burnout_velocity_eci_m_s)
        )
        time = mp.mpf(float(time_s[row]))
        end = fixed(two_body(start, speed, time - mp.mpf(float(result.burnout_s[row])))[0], time)
        miss[row] = float(norm(less([mp.mpf(float(v)) for v in at[row]], end)))
    return (ignition, time_s), miss, tolerance + 2e4 * np.spacing(time_s)


NAMES = ("j2", "j3", "j4")


def under_forces(rng, n):
    """Return the errors of propagation under zonal gravity, over its tolerance, 1 mm to 1e-6 m."""
    position, velocity, _ = falls(rng, n)
    duration = draws.log_uniform(rng, n, 1.0, 500.0) * rng.choice([-1.0, 1.0], n)
    far = flight.propagate_kepler(position, velocity, duration)[0]
    # Through the Earth's middle the field is no field.
    keep = (np.sqrt((far**2).sum(axis=1)) > 5e6) & (np.abs(velocity).sum(axis=1) > 2e3)
    duration = np.where(keep, duration, 1.0)
    tolerance = 10.0 ** rng.uniform(-6.0, -3.0, n)
    end, _ = flight.propagate(
        position, velocity, duration, flight.Forces(zonal=NAMES), tolerance_m=tolerance
    )
    exact, _ = propagated(position, velocity, duration, NAMES)
    return (
        (position, velocity, duration),
        np.sqrt(((end - exact) ** 2).sum(axis=1)).astype(float),
        tolerance,
    )


def forced_impacts(rng, n):
    """Return the distances of impacts under zonal gravity from the exact ends, and of their
    heights, over 1 mm.
    """
    position, velocity, height = falls(rng, 4 * n)
    duration, point = flight.impact(
        position, velocity, height, flight.Forces(zonal=NAMES), tolerance_m=1e-3
    )
    radial = (position * velocity).sum(axis=1)
    rows = np.flatnonzero(
        np.isfinite(duration) & (duration > 1.0) & (np.abs(radial) > 0.2 * 6.4e6 * 1e3)
    )[:n]
    end, _ = propagated(position[rows], velocity[rows], duration[rows], NAMES)
    separation = np.sqrt(((point[rows] - end) ** 2).sum(axis=1)).astype(float)
    with mp.workdps(40):
        low = np.array(
            [
                float(
                    abs(
                        geodetic([mp.mpf(float(v)) for v in point[row]])[2]
                        - mp.mpf(float(height[row]))
                    )
                )
                for row in rows
            ]
        )
    return (
        (position[rows], velocity[rows], height[rows]),
        separation + low,
        np.full(len(rows), 1e-3),
    )


def _ellipse(rng, n):
    return (
        draws.log_uniform(rng, n, 6.6e6, 4e8),
        draws.uniform(rng, n, 0.0, 0.95, (0.0, 1e-300, 1e-9, 0.999999)),
        draws.uniform(rng, n, 0.0, np.pi, (0.0, 0.5 * np.pi, np.pi)),
        draws.angles(rng, n),
        draws.angles(rng, n),
        draws.angles(rng, n),
    )


def _each(function):
    """Return a function of columns from one of numbers that returns `Elements` or a number."""
    return lambda *columns: np.array(
        [function(*row) for row in zip(*(c.tolist() for c in columns), strict=True)]
    )


def _elements(a, e, i, node, perigee, anomaly):
    return orbits.Elements(
        semi_major_axis_m=a,
        eccentricity=e,
        inclination_rad=i,
        node_longitude_rad=node,
        argument_of_perigee_rad=perigee,
        mean_anomaly_rad=anomaly,
    )


def _perigee_states(*columns):
    states = _each(lambda *row: _elements(*row).perigee_state_eci())(*columns)
    return states[:, 0], states[:, 1]


def perifocal(i, node, perigee):
    cn, sn, ci, si, cw, sw = (f(v) for v in (node, i, perigee) for f in (mp.cos, mp.sin))
    return (
        [cn * cw - sn * sw * ci, sn * cw + cn * sw * ci, sw * si],
        [-cn * sw - sn * cw * ci, -sn * sw + cn * cw * ci, cw * si],
    )


def perigee_state(a, e, i, node, perigee, _):
    towards, along = perifocal(i, node, perigee)
    radius = a * (1 - e)
    return times(radius, towards), times(mp.sqrt(MU / radius * (1 + e)), along)


def orbital_position(altitude, inclination, node, latitude, time):
    """Return the ECEF position of a circular orbit, by its uniform turn."""
    radius = A + altitude * 1000
    angle = latitude * mp.pi / 180 + mp.sqrt(MU / radius**3) * time
    towards, along = perifocal(inclination * mp.pi / 180, node * mp.pi / 180, mp.mpf(0))
    place = [
        radius * (mp.cos(angle) * t + mp.sin(angle) * u)
        for t, u in zip(towards, along, strict=True)
    ]
    return fixed(place, time)


def _circular(rng, n):
    return (
        rng.uniform(200.0, 36000.0, n),
        rng.choice([0.0, 28.5, 63.4, 90.0, 98.7, 180.0], n),
        rng.uniform(-180.0, 180.0, n),
        rng.uniform(0.0, 360.0, n),
        draws.log_uniform(rng, n, 1e-3, 1e9, (0.0,)),
    )


def orbit_positions(rng, n):
    """Return the errors of fitted orbits, from now to thirty years ahead, over 1 cm and the
    rounding of the phase.
    """
    columns = _circular(rng, n)
    miss = np.zeros(n)
    bound = np.zeros(n)
    for row, (altitude, tilt, node, latitude, time) in enumerate(
        zip(*(c.tolist() for c in columns), strict=True)
    ):
        config = orbits.CircularConfig(
            altitude_km=altitude,
            inclination_deg=tilt,
            lon_asc_node_deg=node,
            arg_latitude_deg=latitude,
        )
        result = orbits.orbit_of(orbits.OrbitConfig(circular=config), 0).position_ecef_m(
            np.array([time])
        )[0]
        exact = orbital_position(*(mp.mpf(v) for v in (altitude, tilt, node, latitude, time)))
        miss[row] = float(norm(less([mp.mpf(float(v)) for v in result], exact)))
        bound[row] = 0.01 + 8e3 * time * 2.0**-50
    return columns, miss, bound


CASES = (
    Case("flight.propagate_kepler", arcs, flight.propagate_kepler, two_body, share=0.3, digits=56),
    Case("orbits.Elements.perigee_state_eci", _ellipse, _perigee_states, perigee_state, fixed=(5,)),
    Case(
        "orbits.synchronous_semi_major_axis_m",
        lambda r, n: (r.uniform(0.5, 16.0, n),),
        _each(orbits.synchronous_semi_major_axis_m),
        lambda turns: mp.cbrt(MU / (turns * OMEGA) ** 2),
    ),
    Case(
        "orbits.circular_elements",
        lambda r, n: (
            r.uniform(2e5, 4e7, n),
            draws.angles(r, n),
            draws.angles(r, n),
            draws.angles(r, n),
        ),
        _each(lambda *row: orbits.circular_elements(*row).semi_major_axis_m),
        lambda altitude, *_: A + altitude,
    ),
    Case(
        "orbits.slot_elements",
        lambda r, n: (
            draws.angles(r, n),
            r.uniform(0.0, 0.5, n),
            draws.angles(r, n),
            draws.angles(r, n),
        ),
        _each(
            lambda slot, e, w, u: (
                lambda found: (
                    found.node_longitude_rad
                    + found.argument_of_perigee_rad
                    + found.mean_anomaly_rad
                )
            )(
                orbits.slot_elements(
                    slot, eccentricity=e, argument_of_perigee_rad=w, mean_argument_of_latitude_rad=u
                )
            )
        ),
        lambda slot, *_: slot,
        scale=(2.0 * np.pi,),
    ),
    Case(
        "orbits.highly_elliptical_elements",
        lambda r, n: (
            r.choice([1.0, 2.0], n),
            r.uniform(0.0, 0.75, n),
            draws.angles(r, n),
            r.uniform(-1e6, 1e6, n),
        ),
        _each(lambda *row: orbits.highly_elliptical_elements(*row).node_longitude_rad),
        lambda turns, e, longitude, time: (
            longitude
            + OMEGA * time
            + mp.pi / 2
            - mp.pi / 2
            - mp.atan2(
                mp.cos(mp.mpf(orbits.CRITICAL_INCLINATION_RAD))
                * mp.sin(mp.mpf(1.5 * np.pi) + mp.pi),
                mp.cos(mp.mpf(1.5 * np.pi) + mp.pi),
            )
        ),
        scale=(2.0 * np.pi,),
    ),
    Case(
        "orbits.walker_pattern",
        lambda r, n: (r.uniform(2e5, 2e6, n), draws.latitudes(r, n), draws.angles(r, n)),
        _each(
            lambda altitude, tilt, node: (
                orbits.walker_pattern(24, 6, 1, altitude, tilt, first_node_longitude_rad=node)[
                    23
                ].node_longitude_rad
            )
        ),
        lambda altitude, tilt, node: node + 5 * mp.pi / 3,
        scale=(2.0 * np.pi,),
    ),
)

BOUNDS = (
    Bound(
        "flight.kepler_impact",
        "1e-6 m and rounding of the time",
        kepler_impacts,
        share=0.1,
        digits=56,
    ),
    Bound("flight.aim", "0.01 m and rounding of the time", aims, share=0.1, digits=56),
    Bound("flight.boost_ephemeris", "the tolerance", boosts, share=0.2),
    Bound("flight.coast_ephemeris", "the tolerance", coasts, share=0.1, digits=56),
    Bound("flight.propagate", "the tolerance, j2 to j4", under_forces, share=0.3),
    Bound("flight.impact", "0.001 m, j2 to j4", forced_impacts, share=0.2),
    Bound("orbits.orbit_of", "0.01 m and rounding of the phase", orbit_positions, share=0.1),
)

LEFT_OUT = {
    "flight": {
        **dict.fromkeys(("BoostPath", "GlideShape", "ImpactReason", "ImpactStates"), "a record"),
        "GlidePath": "a closed form, held to SciPy (tests/against/test_against_scipy_glide.py)",
        **dict.fromkeys(("ForceModel", "Gravity", "LOWEST_HEIGHT_M"), "a type or a constant"),
        "density_kg_m3": "a fit to a table (tests/against/test_against_us_standard_density.py)",
        "forces_of": "looks a name up",
        **dict.fromkeys(("joined_burns_s", "plain_gaps_s"), "the times given, laid out otherwise"),
        **dict.fromkeys(
            ("height_and_up", "height_m"), "through ecef_to_geodetic, to 2e-8 m (tests/core/flight)"
        ),
        "impact_states_eci": "through impact and kepler_impact",
        "Aim": "a record",
        "BoostProfile": "a record",
        "Drag": "a record; drag is held to SciPy (tests/against/test_against_scipy_propagation.py)",
        "free_flight_ephemeris": "through coast_ephemeris",
        "Ephemeris": "through boost_ephemeris and coast_ephemeris",
        "Forces": "a record",
        **dict.fromkeys(
            ("ascent", "boost_path", "launch_site"), "through aim, whose bound flies the path"
        ),
        "boost_profile": "looks a name up",
        "boost_profiles": "looks names up",
    },
    "orbits": {
        "GeostationaryOrbit": "a fixed point; through geodetic_to_ecef",
        "CRITICAL_INCLINATION_RAD": "a constant",
        **dict.fromkeys(
            ("MovingOrbit", "Sgp4Motion"),
            "through orbits of elements (tests/against/test_against_sgp4.py)",
        ),
        **dict.fromkeys(
            (
                "age_warning",
                "omm_complaint",
                "omm_epoch",
                "omm_name",
                "satellite_of_omm",
                "satellite_of_tle",
                "tle_complaint",
            ),
            "reading and words",
        ),
        **dict.fromkeys(
            [
                "CircularConfig",
                "KeplerConfig",
                "MolniyaConfig",
                "OmmFileConfig",
                "OrbitConfig",
                "SlotConfig",
                "TundraConfig",
                "WalkerConfig",
            ],
            "settings; their numbers through orbit_of",
        ),
        "Eclipses": "a record",
        "Elements": "a record; through perigee_state_eci",
        "Outages": "a record",
        "contact_intervals": "to 1 ms, by elevations"
        " (tests/against/test_against_skyfield_contacts.py)",
        "crosslink_intervals": "to 1 ms, by grazing heights (tests/core/orbits)",
        "eclipse_intervals": "to 1 ms, by sunlit discs"
        " (tests/against/test_against_astropy_sun_events.py)",
        "outage_intervals": "a search to 1 ms in nadir angles (tests/core/orbits)",
        "elements_of": "selects; through orbit_of",
    },
}
