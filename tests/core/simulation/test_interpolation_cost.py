"""What knots cost, in counts: how many looks a pair is asked for, and in how many calls."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from opir_photons.radiometry.earth import EarthBackground
from opir_photons.radiometry.lowtran import LowtranAtmosphere
from opir_photons.radiometry.plume import PlumeSignatures
from opir_testing.bench import bench_scene
from scipy.special import ndtr

import opir_core as opir
from opir_core.geometry import ecef_to_geodetic
from opir_core.planning import Looks
from opir_core.simulation import ProbabilityInterpolant
from opir_core.simulation.refinement import KNOTS, GridRefiner, certain_beyond

AIR = {"atmosphere": "lowtran", "background": "earth"}


#: A plume is not subtracted from itself.
STILL = {"focal_plane": {"temporal_filter": "none"}}


def planned(
    calibrate: str, sky: dict[str, Any], tolerance: float = 1e-4, **every_sensor: Any
) -> Any:
    targets = [
        {
            "id": name,
            "type": kind,
            "launch": {
                "lat_deg": 5.0 - 3.0 * number,
                "lon_deg": -150.0 + 5.0 * number,
                "time_s": 2.0 + number,
            },
            "aim": {"lat_deg": aim[0], "lon_deg": aim[1]},
        }
        for number, (name, kind, aim) in enumerate(
            [("I", "ICBM", (-50.0, -110.0)), ("R", "IRBM", (-28.0, -170.0))]
        )
    ]
    sensors = [
        {
            "model": "DSP",
            "preset": "paper",
            "scan_phase": "random",
            "id": "D",
            "orbital_slot_deg": -140.0,
            **every_sensor,
        },
        {"model": "SBIRS-GEO", "id": "B", "orbital_slot_deg": -150.0, **every_sensor},
        {"model": "NEXTGEN-GEO", "id": "N", "orbital_slot_deg": -120.0, **every_sensor},
    ]
    detection = {"model": "snr", "calibrate": calibrate, "probability_tolerance": tolerance}
    scene = {
        "scene": "budget",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 300,
        "seed": 1,
        "outputs": [],
        **sky,
    }
    return opir.compile_plan(
        opir.scene_from_mapping(
            {**scene, "sensors": sensors, "targets": targets, "detection": detection}
        )
    )


class Counting:
    """A model that counts what it is asked."""

    def __init__(self, model: Any) -> None:
        self.asked: list[tuple[int, int]] = []
        self._model = model
        self.probability_tolerance = model.probability_tolerance
        self.breakpoints_s = model.breakpoints_s
        self.measure_response = model.measure_response

    def response(self, exposed: Any, *, slack: float = 0.0) -> Any:
        looks: Sequence[tuple[int, int]] = list(
            zip(exposed.sensor.tolist(), exposed.target.tolist(), strict=True)
        )
        self.asked.append((len(looks), len(set(looks))))
        return self._model.response(exposed, slack=slack)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("calibrate", "sky", "frames", "most"),
    # A difference of frames bends signals, while a plume moves away from where it was, at a lag
    # that is 10 s.
    [
        ("none", {}, STILL, 120),
        # Without the two breakpoints of pitch-over 150. These add a piece of three knots, and one
        # of 0.1 s, whose looks are evaluated: two, where the period is 50 ms.
        ("none", {}, {}, 150 + 3 + 2),
        ("none", AIR, {}, 165),
        ("paper", {}, {}, 150),
        ("paper", AIR, {}, 150),
    ],
    ids=[
        "empty space, frames as they are",
        "empty space",
        "air",
        "calibrated",
        "calibrated in air",
    ],
)
def test_a_pair_is_asked_for_few_looks_in_few_calls(
    calibrate: str, sky: dict[str, Any], frames: dict[str, Any], most: int
) -> None:
    plan = planned(calibrate, sky, **frames)
    counting = Counting(plan.detection)
    ProbabilityInterpolant.of(plan.look_geometry(), counting, 1e-4)
    pairs = int((plan.pairs.looks > 0).sum())
    assert sum(rows for rows, _ in counting.asked) <= most * pairs
    # One call a halving, all pairs at once.
    assert len(counting.asked) <= 9
    assert counting.asked[0][1] == pairs


@pytest.mark.parametrize("others", [0, 1])
def test_a_slow_scanner_is_asked_for_few_more_than_its_looks(others: int) -> None:
    # Few looks in a burn: curves between all breakpoints would need four times as many.
    slow = {
        "model": "DSP",
        "preset": "paper",
        "scan_phase": "random",
        "id": "SLOW",
        "orbital_slot_deg": -135,
        "scan_period_ms": 10_000,
    }
    fast = {"model": "SBIRS-GEO", "id": "FAST", "orbital_slot_deg": -90}
    plan = opir.compile_plan(
        opir.scene_from_mapping(
            bench_scene(sensors=[slow, fast][: 1 + others], detection="snr", duration_s=260)
        )
    )
    counting = Counting(plan.detection)
    product = ProbabilityInterpolant.of(plan.look_geometry(), counting, 1e-4)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    actual = plan.pairs.sensor[looks.pair] == 0
    exact = ndtr(
        plan.detection.response(plan.look_geometry().exposures(looks.pair, looks.scan)).probit
    )
    assert 3 < np.count_nonzero(actual) < 60
    assert np.abs(product.over(looks).probability() - exact)[actual].max() <= 1e-8
    if not others:
        assert sum(rows for rows, _ in counting.asked) <= 1.7 * len(looks.pair)


def test_pieces_that_are_certain_have_three_knots_and_no_more() -> None:
    plan = planned("none", {})
    grid = GridRefiner(plan.look_geometry(), plan.detection, 1e-4).refined()
    assert len(grid.settled.scan) == 3
    assert len(grid.curved.scan) == KNOTS
    assert len(grid.settled.pair) > 0.5 * len(grid.curved.pair)
    assert np.all(np.abs(grid.values[0].take(grid.settled.row)) > certain_beyond(1e-4))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_rounding_to_certain_costs_1e_4_of_the_tolerance(
    tolerance: float,
) -> None:
    plan = planned("none", {}, tolerance)
    knots = ProbabilityInterpolant.of(plan.look_geometry(), plan.detection, tolerance)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair, looks.scan)
    probability = knots.over(looks).probability()
    exact = ndtr(plan.detection.response(exposed).probit)
    sure = (probability == 0.0) | (probability == 1.0)
    assert sure.mean() > 0.5
    assert np.abs(probability - exact)[sure].max() <= 1.1e-4 * tolerance


def test_values_are_seldom_copied_and_heights_are_geodetic(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = planned("none", {})
    refiner = GridRefiner(plan.look_geometry(), plan.detection, 1e-4)
    rooms = []
    keep = GridRefiner._keep

    def keeping(self: GridRefiner, values: np.ndarray) -> None:
        keep(self, values)
        rooms.append(self._known.shape[1])

    monkeypatch.setattr(GridRefiner, "_keep", keeping)
    grid = refiner.refined()
    assert len(rooms) >= 5
    assert 2 <= len(set(rooms)) <= 3
    assert grid.values.shape[1] == refiner._count <= rooms[-1]
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair[::53], looks.scan[::53])
    true_m = ecef_to_geodetic(exposed.target_ecef_m).height_m
    assert np.abs(plan.detection.environment.paths(exposed).height_m - true_m).max() < 3e-8


def test_pitch_over_is_reported_beside_what_plumes_and_air_tell() -> None:
    plan = planned("none", {})
    reported_s = plan.detection.breakpoints_s()
    pitched_s = plan.targets.trajectories[0].course_breakpoints_s
    assert np.all(
        (plan.targets.ignition_s < pitched_s[:, 0]) & (pitched_s[:, 0] < plan.targets.burnout_s)
    )
    # The direction of flight is that over 0.1 s about a look, so it bends from 0.05 s before to
    # 0.05 s after.
    for off_s in (-0.05, 0.05):
        assert np.all((reported_s[:, :, None] == pitched_s[:, None, :] + off_s).any(axis=(1, 2)))
    # Before it flight is vertical: the direction bends there, not sooner.
    everyone = np.arange(len(pitched_s), dtype=np.int32)
    up = plan.targets.position_ecef_m(everyone, plan.targets.ignition_s + 0.5)
    higher = plan.targets.position_ecef_m(everyone, pitched_s[:, 0] - 0.5)
    way = higher - up
    vertical = up / np.linalg.norm(up, axis=1)[:, None]
    assert np.all((way * vertical).sum(axis=1) > 0.99999 * np.linalg.norm(way, axis=1))


@pytest.mark.parametrize("sky", [{}, AIR], ids=["empty space", "air"])
def test_what_models_say_of_all_bands_at_once_they_say_of_each(sky: dict[str, Any]) -> None:
    plan = planned("none", sky)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    environment = plan.detection.environment
    complete = slice(None, None, 97)
    exposed = plan.look_geometry().exposures(looks.pair[complete], looks.scan[complete])
    view = environment.views(exposed)
    path = environment.paths(exposed)
    aspect = environment.aspect_rad(exposed)
    bands = list(range(len(environment.bands)))
    radiance, clutter = environment.background.radiances_and_clutter_w_m2_sr(bands, view)
    passed = environment.atmosphere.transmittances(bands, path)
    since_s = exposed.emission_time_s - plan.targets.ignition_s[exposed.target]
    columns = (environment.place[exposed.target], since_s, path.height_m, aspect)
    intensity = environment.signatures[0].intensities_w_sr(bands, *columns)
    for band in bands:
        assert np.array_equal(radiance[band], environment.background.radiance_w_m2_sr(band, view))
        assert np.array_equal(clutter[band], environment.background.clutter_w_m2_sr(band, view))
        assert np.array_equal(passed[band], environment.atmosphere.transmittance(band, path))
        assert np.array_equal(
            intensity[band], environment.signatures[0].intensity_w_sr(band, *columns)
        )
        assert intensity[band].max() > 0.0
        assert (radiance[band].max() > 0.0) == bool(sky)


def test_models_are_called_once_for_all_bands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = planned("none", AIR)
    calls: list[str] = []
    for kind, name in (
        (PlumeSignatures, "_thrust"),
        (LowtranAtmosphere, "_looked_up"),
        (EarthBackground, "_radiances_w_m2_sr"),
    ):
        inner = getattr(kind, name)
        monkeypatch.setattr(
            kind,
            name,
            lambda *arguments, inner=inner, name=name: calls.append(name) or inner(*arguments),
        )
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair[::97], looks.scan[::97])
    plan.detection.response(exposed)
    # Plumes and air also for the light of a lag earlier, which frames subtract.
    expected = {
        name: len(plan.sensors) * (1 if name == "_radiances_w_m2_sr" else 2) for name in calls
    }
    assert {name: calls.count(name) for name in calls} == expected
    assert len(set(calls)) == 3
