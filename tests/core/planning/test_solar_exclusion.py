"""Solar exclusion: the looks that it prevents, by each look's own geometry, and its cost where it
prevents none.

The scenes stand around local midnight of the spring equinox, when the Sun passes behind the Earth
for a geostationary satellite: it stands beyond the west limb from 446 s to 2022 s of scene time,
and beyond the east limb from 6070 s.
"""

from unittest import mock

import numpy as np
import pytest
from attrs import evolve, fields
from opir_testing import CertainDetection, VerticalTargets, stub_plan, stub_scene, stub_sensor
from snr_scene import scene as snr_scene

import opir_core.orbits.sun_events
import opir_core.planning.solar_exclusion
from opir_core import Engine, compile_plan
from opir_core.geometry import is_sunlit, sun_position_ecef_m
from opir_core.geometry.crossings import intervals_below
from opir_core.live.changes import with_added_targets
from opir_core.orbits import CircularConfig, OrbitConfig, orbit_of
from opir_core.planning import Looks, visible_now
from opir_core.planning.sightlines import Blocked, Visibility
from opir_core.plugin import Detections
from opir_core.sensors import AlignedScan
from opir_core.simulation.explanation import explained

EPOCH = np.datetime64("2026-03-20T11:00:00", "us")
EPOCH_US = int(EPOCH.astype(np.int64))
DURATION_S = 9000.0
PERIOD_NS = 500_000_000
GEO = {
    "slot_deg": 180.0,
    "scan": AlignedScan(PERIOD_NS),
    "field_of_regard_half_angle_rad": np.radians(10.0),
}


def low_orbit():
    config = CircularConfig(altitude_km=1200.0, inclination_deg=20.0, lon_asc_node_deg=150.0)
    return orbit_of(OrbitConfig(circular=config), EPOCH_US)


def targets(count=150, seed=3, west_deg=100.0, east_deg=260.0):
    rng = np.random.default_rng(seed)
    ignition_s = rng.uniform(0.0, DURATION_S - 150.0, count)
    places = rng.uniform(-70.0, 70.0, count), rng.uniform(west_deg, east_deg, count)
    return VerticalTargets(*places, ignition_s, ignition_s + rng.uniform(20.0, 140.0, count))


def plan(exclusion_deg=5.0, made=None, **changes):
    sensor = stub_sensor(**(GEO | {"solar_exclusion_rad": np.radians(exclusion_deg)} | changes))
    made = targets() if made is None else made
    scene = evolve(stub_scene(duration_s=DURATION_S, light_time=False), epoch_us=EPOCH_US)
    ids = [f"T{number}" for number in range(len(made.ignition_s))]
    return stub_plan([sensor], made, ids, scene, detection=CertainDetection(1.0, False))


def detections(made, edges_s=(DURATION_S,)):
    engine = Engine(made)
    return Detections.concatenate(
        [engine.advance(round(edge * 1e9)).detections for edge in edges_s]
    )


def looks_of(window):
    return set(zip(window.truth.target.tolist(), window.detections.scan.tolist(), strict=True))


def expected_looks(made):
    """Every look of every burn, with the angle to the Sun by its cosine: those that see, and those
    the Sun prevents.
    """
    trajectories = made.targets.trajectories[0]
    (sensor,) = made.sensors
    looks_seen = set()
    prevented = set()
    for target in range(len(made.targets.ids)):
        ignition_s = trajectories.ignition_s[target]
        burnout_s = trajectories.burnout_s[target]
        scans = np.arange(np.floor(ignition_s / 0.5) + 1, np.floor(burnout_s / 0.5) + 1).astype(
            np.int64
        )
        time_s = scans * 0.5
        sensor_m = sensor.orbit.position_ecef_m(time_s)
        target_m = trajectories.position_ecef_m(np.full(len(scans), target), time_s)
        sun_m = sun_position_ecef_m(EPOCH, time_s)
        way = target_m - sensor_m
        towards = sun_m - sensor_m
        cosine = (
            np.sum(way * towards, axis=1)
            / np.linalg.norm(way, axis=1)
            / np.linalg.norm(towards, axis=1)
        )
        neighbours = (np.arccos(cosine) < sensor.solar_exclusion_rad) & is_sunlit(sensor_m, sun_m)
        visible = visible_now(sensor, sensor_m, target_m)
        looks_seen |= {(target, int(scan)) for scan in scans[visible & ~neighbours]}
        prevented |= {(target, int(scan)) for scan in scans[visible & neighbours]}
    return looks_seen, prevented


CASES = {
    "geostationary": {},
    "geostationary-wide": {"exclusion_deg": 12.0},
    "low-orbit": {
        "orbit": low_orbit(),
        "field_of_regard_half_angle_rad": 1.4,
        "exclusion_deg": 50.0,
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_looks_are_those_away_from_the_sun(name):
    compiled = plan(**CASES[name])
    window = Engine(compiled).advance(compiled.end_ns)
    looks_read, prevented = expected_looks(compiled)
    look_times_s = looks_of(window)
    assert len(look_times_s) > 1000
    assert len(prevented) > 200
    assert look_times_s == looks_read


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_most_cells_are_certain(name):
    """Cells without a look test are as certain as for the other conditions; those near the Sun's
    edge are tested.
    """
    compiled = plan(**CASES[name])
    pairs = compiled.pairs
    sight = compiled.sightlines.sight
    looks = Looks.between(pairs, 0, compiled.end_ns)
    place = compiled.sightlines.place(looks.pair, looks.scan * 0.5)
    exact = compiled.look_geometry().visible(looks.pair, looks.scan)
    kinds = sight[place.point]
    looks_read, _ = expected_looks(compiled)
    truly = np.array(
        [
            (t, s) in looks_read
            for t, s in zip(pairs.target[looks.pair].tolist(), looks.scan.tolist(), strict=True)
        ]
    )
    assert truly[kinds == Visibility.ALWAYS].all()
    assert not truly[kinds == Visibility.NEVER].any()
    assert np.array_equal(exact, truly)
    assert np.mean(kinds == Visibility.UNCERTAIN) < 0.4


def test_windows_cut_anywhere_give_the_same_bytes():
    uncut = detections(plan())
    cut = detections(plan(), (446.2, 1000.0, 1893.7, 2022.05, 2022.1, 6070.3, DURATION_S))
    for column in fields(Detections):
        assert getattr(uncut, column.name).tobytes() == getattr(cut, column.name).tobytes(), (
            column.name
        )


def in_the_west():
    """One target at the west limb that burns while the Sun stands there."""
    return VerticalTargets(np.zeros(1), np.array([107.0]), np.array([1900.0]), np.array([2000.0]))


def test_a_pair_blinded_throughout_has_no_looks():
    compiled = plan(made=in_the_west())
    assert compiled.pairs.blocked.tolist() == [Blocked.NEAR_THE_SUN]
    assert compiled.pairs.looks.tolist() == [0]
    assert plan(exclusion_deg=0.0, made=in_the_west()).pairs.looks.tolist() == [200]


def test_targets_added_to_a_running_scene_are_blinded_too():
    """A launch 70 degrees west of a slot, four minutes before the Sun sets behind the west limb."""
    sensors = [{"model": "generic-scanner", "id": "S", "orbital_slot_deg": -65.0}]
    later = {"epoch": "2026-03-20T03:50:00Z", "duration_s": 90, "detection": "constant"}
    plain = compile_plan(snr_scene(sensors, names="I", **later))
    joined_plan = with_added_targets(plain, compile_plan(snr_scene(sensors, names="S", **later)))
    assert joined_plan.targets.ids == ("I", "S")
    assert joined_plan.pairs.blocked[1] == Blocked.NEAR_THE_SUN
    assert joined_plan.exclusions is plain.exclusions


class Count:
    """Calls of the functions of the Sun that planning and looks use."""

    def __enter__(self):
        places = (opir_core.orbits.sun_events, opir_core.planning.solar_exclusion)
        self.patches = [
            mock.patch.object(place, "sun_ecef_m", side_effect=place.sun_ecef_m) for place in places
        ]
        self.events, self.looks = (patch.start() for patch in self.patches)
        return self

    def __exit__(self, *_):
        for patch in self.patches:
            patch.stop()


def test_without_an_exclusion_angle_the_sun_is_never_asked_for():
    with Count() as count:
        detections(plan(exclusion_deg=0.0))
    assert count.events.call_count == 0
    assert count.looks.call_count == 0


def test_where_the_sun_stays_away_looks_do_not_ask_for_it():
    """A quarter of a turn from midnight: planning asks for the Sun once, and that is all."""
    with Count() as count:
        compiled = plan(slot_deg=90.0, made=targets(west_deg=30.0, east_deg=150.0))
        assert len(detections(compiled)) > 1000
    assert count.events.call_count == 0
    assert count.looks.call_count == 1
    assert compiled.exclusions == (None,)


def test_planning_samples_the_sun_twice_a_minute():
    with mock.patch.object(
        opir_core.orbits.sun_events, "intervals_below", side_effect=intervals_below
    ) as results:
        plan(slot_deg=180.0)
    assert [call.kwargs["step_s"] for call in results.call_args_list] == [30.0]


def test_long_scenes_are_searched_in_pieces():
    sensor = stub_sensor(**(GEO | {"solar_exclusion_rad": np.radians(5.0)}))
    exclusion = opir_core.planning.solar_exclusion.SolarExclusion.of(sensor, EPOCH_US, 3 * 86_400.0)
    module = opir_core.planning.solar_exclusion
    reach_s = list[float]()
    search = opir_core.orbits.sun_events.outage_times_s

    def searched(sensor, epoch_us, start_s, stop_s, **settings):
        reach_s.append(stop_s - start_s)
        return search(sensor, epoch_us, start_s, stop_s, **settings)

    with (
        mock.patch.object(module, "_SPAN_S", 1000.0),
        mock.patch.object(opir_core.orbits.sun_events, "outage_times_s", searched),
    ):
        pieces = module.SolarExclusion.of(sensor, EPOCH_US, 3 * 86_400.0)
    assert max(reach_s) <= 1001.0
    assert len(pieces.start_s) > len(exclusion.start_s) >= 6
    rng = np.random.default_rng(5)
    time_s = rng.uniform(0.0, 3 * 86_400.0, 20_000)
    position_m = sensor.orbit.position_ecef_m(time_s)
    sunward = sun_position_ecef_m(EPOCH, time_s) / 1.496e11
    target_m = position_m + 4e7 * sunward + rng.normal(0.0, 2e6, position_m.shape)
    clear = [
        part_or_whole.is_clear(position_m, target_m, time_s)
        for part_or_whole in (exclusion, pieces)
    ]
    assert np.array_equal(*clear)
    assert 0 < np.count_nonzero(~clear[0]) < 2000


def test_explain_lists_outages_and_eclipses():
    sensors = [{"model": "generic-scanner", "id": "S", "orbital_slot_deg": 180.0}]
    checked_scene = snr_scene(
        sensors, names="S", epoch="2026-03-20T11:00:00Z", duration_s=9000, detection="constant"
    )
    reported = explained(compile_plan(checked_scene))
    west, east = reported["outages"]
    assert (west["azimuth_at_stop_deg"], east["azimuth_at_start_deg"]) == pytest.approx(
        (270.0, 90.0), abs=3.0
    )
    assert west["stop_s"] == pytest.approx(reported["eclipses"][0]["umbra_start_s"], abs=0.01)
    assert 0.1 < west["share_of_field"] < 0.25
    # The field's own edge reaches the exclusion when the Sun is 15 degrees from nadir.
    assert west["start_s"] == pytest.approx(446.0, abs=1.0)
    within = snr_scene(
        sensors, names="S", epoch="2026-03-20T11:10:00Z", duration_s=100, detection="constant"
    )
    (complete,) = explained(compile_plan(within))["outages"]
    assert (complete["start_s"], complete["stop_s"]) == (0.0, 100.0)


def test_the_sun_is_looked_for_between_the_ends_of_outages_only():
    exclusion = opir_core.planning.solar_exclusion.SolarExclusion(
        angle_rad=0.1,
        epoch_us=EPOCH_US,
        start_s=np.array([10.0, 100.0]),
        stop_s=np.array([20.0, 200.0]),
    )
    time_s = np.array([9.9, 10.0, 20.0, 20.1, 99.9, 100.0, 200.0, 200.1])
    sunward = sun_position_ecef_m(EPOCH, time_s) / 1.496e11
    margin = exclusion.margin_rad(42.2e6 * sunward, 84.4e6 * sunward, time_s)
    assert margin[np.isfinite(margin)] == pytest.approx(-0.1, abs=1e-6)
    assert np.isinf(margin).tolist() == [True, False, False, True, True, False, False, True]


def test_false_alarms_stay_away_from_the_sun_as_well():
    noisy = {
        "model": "generic-scanner",
        "id": "S",
        "orbital_slot_deg": 180.0,
        "threshold_sigma": 3.9,
    }

    def window(**changes):
        checked_scene = snr_scene(
            [{**noisy, **changes}], names="S", epoch="2026-03-20T11:30:00Z", duration_s=10
        )
        return Engine(compile_plan(checked_scene)).advance(10_000_000_000).detections

    free = window(solar_exclusion_deg=0.0)
    selected = window(solar_exclusion_deg=5.0)
    time_s = free.time_ns * 1e-9
    towards = sun_position_ecef_m(np.datetime64("2026-03-20T11:30:00"), time_s) - free.sensor_ecef_m
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    neighbours = np.arccos(np.sum(towards * free.line_of_sight_ecef, axis=1)) < np.radians(5.0)
    assert 20 < np.count_nonzero(neighbours) < len(free) - 20
    assert {tuple(row) for row in selected.detection_id.tolist()} == {
        tuple(row) for row in free.detection_id[~neighbours].tolist()
    }


def test_the_sun_is_at_the_west_limb_before_midnight():
    two_targets = VerticalTargets(
        np.zeros(2), np.array([107.0, 253.0]), np.full(2, 1900.0), np.full(2, 2000.0)
    )
    assert plan(made=two_targets).pairs.looks.tolist() == [0, 200]
