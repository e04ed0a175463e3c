"""The model `snr` and its formulae: probabilities between knots, detections by signal, extremes of
noise.
"""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from scipy.special import ndtr
from snr_scene import DSP, NEAR_THRESHOLD, NEXTGEN, SBIRS, joined, scene, windows_of

import opir_core as opir
from opir_core import Engine
from opir_core.errors import ModelError
from opir_core.planning import Looks
from opir_core.simulation import ProbabilityInterpolant
from opir_core.simulation.probability import interpolant_of
from opir_core.simulation.refinement import SIGNAL_SHARE, SIGNAL_SIGMA

SKIES = {
    "empty space": {},
    "air": {"atmosphere": "lowtran", "background": "earth"},
    "cloud": {
        "atmosphere": {
            "model": "lowtran",
            "climate": "tropical",
            "cloud": {"top_km": 9.0, "cover": 0.5},
        }
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("sky", SKIES)
@pytest.mark.parametrize(
    "sensors", [(DSP, SBIRS, NEXTGEN), NEAR_THRESHOLD], ids=["bright", "near the threshold"]
)
@pytest.mark.parametrize(
    "tolerance", [1e-4, *(pytest.param(each, marks=pytest.mark.slow) for each in (1e-2, 1e-6))]
)
def test_between_knots_no_look_is_off_by_more_than_the_tolerance(
    sky: str, sensors: Any, tolerance: float
) -> None:
    selected = {"model": "snr", "probability_tolerance": tolerance}
    near = opir.compile_plan(scene(sensors, detection=selected, duration_s=220, **SKIES[sky]))
    interpolant = interpolant_of(near, near.look_geometry())
    looks = Looks.between(near.pairs, 0, near.end_ns)
    assert interpolant is not None
    spans = interpolant.over(looks)
    exposed = near.look_geometry().exposures(looks.pair, looks.scan)
    exact = near.detection.response(exposed)
    probability = spans.probability()
    # From 1e-6 downwards changes of slope in the table of the atmosphere add up
    # (docs/explanation/detection.md).
    most = 2.0 * tolerance if tolerance <= 1e-6 else tolerance
    assert np.abs(probability - ndtr(exact.probit)).max() <= most
    # Signals are held midway between knots: where something is seen, hardly any is off by more than
    # is said.
    shared = spans.response(np.arange(len(looks.scan)))
    seen = probability > 1e-7
    off = (
        np.abs(shared.snr - exact.snr)[seen]
        / np.maximum(SIGNAL_SHARE * exact.snr, SIGNAL_SIGMA)[seen]
    )
    assert np.mean(off <= 1.0) > 0.998
    assert off.max() < 3.0
    assert len(interpolant.at[0]) < {1e-2: 0.25, 1e-4: 0.4, 1e-6: 0.8}[tolerance] * len(looks.pair)


@pytest.mark.slow
@pytest.mark.parametrize("calibrate", ["paper", "none"])
def test_models_without_kinks_meet_the_tolerance(calibrate: str) -> None:
    selected = {"model": "snr", "calibrate": calibrate}
    near = opir.compile_plan(
        scene(detection=selected, duration_s=220, atmosphere="lowtran", background="earth")
    )
    mute = evolve(near, detection=_Mute(near.detection))
    looks = Looks.between(near.pairs, 0, near.end_ns)
    exposed = near.look_geometry().exposures(looks.pair, looks.scan)
    exact = ndtr(near.detection.response(exposed).probit)
    knots = [
        ProbabilityInterpolant.of(plan.look_geometry(), plan.detection, 1e-4)
        for plan in (near, mute)
    ]
    for each in knots:
        assert np.abs(each.over(looks).probability() - exact).max() <= 1e-4
    assert len(knots[0].certain) < len(knots[1].certain)
    # Signals of the paper hardly bend where plumes do: known breakpoints save pieces there, but no
    # lines.
    assert calibrate == "paper" or len(knots[0].at[0]) < 0.9 * len(knots[1].at[0])


class _Mute:
    """A model that keeps its kinks to itself."""

    def __init__(self, model: Any) -> None:
        self.probability_tolerance = model.probability_tolerance
        self.response = model.response
        self.measure_response = model.measure_response
        self.breakpoints_s = lambda: None


@pytest.mark.slow
def test_detections_follow_the_formula_in_bins_of_signal() -> None:
    plan = opir.compile_plan(
        scene([DSP], "IR", detection={"model": "snr", "exact": True}, duration_s=200)
    )
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair, looks.scan)
    chance = plan.detection.probability(exposed)
    margin = plan.detection.response(exposed).snr[:, 0] - 5.0
    assert np.allclose(chance, ndtr(margin), rtol=1e-12)
    bins = np.digitize(chance, np.linspace(0.0, 1.0, 21)[1:-1])
    hits = np.zeros(20)
    expected = np.zeros(20)
    spread = np.zeros(20)
    for seed in range(12):
        engine = Engine(evolve(plan, scene=evolve(plan.scene, seed=seed)))
        truth = joined([engine.advance(plan.end_ns)])[1]
        result = truth.probability[truth.target >= 0]
        hits += np.bincount(np.digitize(result, np.linspace(0.0, 1.0, 21)[1:-1]), minlength=20)
        expected += np.bincount(bins, chance, minlength=20)
        spread += np.bincount(bins, chance * (1.0 - chance), minlength=20)
    # 99.9 % over all bins together: 4.06 deviations each, and a count for the discreteness.
    assert np.all(np.abs(hits - expected) <= 4.06 * np.sqrt(spread) + 1.0)


@pytest.mark.parametrize("nei", [0.0, 1e-30, 1.0, 1e6])
def test_no_noise_and_enormous_noise_stay_in_bounds(nei: float) -> None:
    sensor = {**NEXTGEN, "nei_w_m2": nei, "threshold_sigma": 9.0}
    plan = opir.compile_plan(scene([sensor], "I", atmosphere="lowtran"))
    result, truth = joined(windows_of(plan, [60.0]))
    chance = truth.probability[truth.target >= 0]
    assert np.all((chance >= 0.0) & (chance <= 1.0))
    assert np.all(np.isfinite(result.snr))
    assert (len(result) == 0) == (nei >= 1.0)


def test_a_nei_in_w_cm2_is_converted_once() -> None:
    per_m2, per_cm2 = (
        {**DSP, "nei_w_m2": None, "id": "D", key: value}
        for key, value in (("nei_w_m2", 2e-12), ("nei_w_cm2", 2e-16))
    )
    one, other = (
        joined(windows_of(opir.compile_plan(scene([sensor], "I")), [60.0]))[0]
        for sensor in (per_m2, per_cm2)
    )
    assert np.array_equal(one.time_ns, other.time_ns)


def test_a_sensor_that_says_nothing_of_light_is_refused() -> None:
    plan = opir.compile_plan(scene([DSP], "I"))
    mute = evolve(plan.sensors[0], radiometer=None)
    from opir_photons.detection.configs import SnrConfig
    from opir_photons.detection.snr import snr_detection

    from opir_core.interfaces.contexts import ModelContext

    context = ModelContext(
        sensors=(mute,),
        target_type_code=plan.targets.type_code,
        surroundings=evolve(plan, sensors=(mute,)),
    )
    with pytest.raises(ModelError, match="does not say how it measures light"):
        snr_detection(SnrConfig(), context)
