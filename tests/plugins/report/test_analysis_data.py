"""Signals, latencies, confidences, regions and scores of plots, against the run, its truth and
`opir score`.
"""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, strategies as st
from matplotlib import pyplot
from opir_photons.detection import latency_cdf
from opir_report import RunPlots
from opir_report.plots.confidence import confidences
from opir_report.plots.consistency import nees_history, region_history
from opir_report.plots.latency import confirmed_by, latency_curves, pair_latencies
from opir_report.plots.scores import score_rows
from opir_report.plots.signal import signals
from opir_report.run_facts import RunFacts
from opir_scoring import evidence_of_run, scorecard, scorecard_text
from opir_scoring.evidence import true_states_ecef
from reported_runs import empty_run, example_run, scored_run
from scored_scene import SCENE

import opir_core as opir
from opir_core.arrays import FloatArray, IntArray


@pytest.fixture(autouse=True)
def closed_figures():
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")


def test_a_constant_model_has_its_probability_and_no_signal() -> None:
    run = example_run("first_light")
    data = signals(RunFacts(run), 0)
    assert set(data["detection_probability"].tolist()) == {
        run.sensors[0].detection_probability["ICBM"]
    }
    assert np.isnan(data["snr"]).all()
    assert np.isnan(data["transmittance"]).all()
    plots = RunPlots(run)
    assert "no signal" in plots.snr().texts[0].get_text()
    assert "no signal" in plots.air().texts[0].get_text()
    assert not plots.probability().texts


def measured_in_reference_band(run: opir.Run, sensor: int, rows: IntArray) -> FloatArray:
    """Return the SNR (n,) that detections of one sensor measured in its reference band; `snr` is of
    all bands.
    """
    plan = run.plan
    found = run.detections
    place = run.sensors[sensor].radiometer.reference
    pair = np.flatnonzero(
        (plan.pairs.sensor == sensor) & (plan.pairs.target == run.truth.target[rows[0]])
    )
    exposures = plan.look_geometry().exposures(np.repeat(pair, len(rows)), found.scan[rows])
    return (
        found.band_irradiance_w_m2[rows, place]
        / plan.detection.response(exposures).noise_w_m2[:, place]
    )


@pytest.mark.slow
def test_probabilities_along_the_boost_are_those_of_the_detections() -> None:
    run = example_run("photons")
    facts = RunFacts(run)
    found = 0
    for target in (0, 1):
        data = signals(facts, target)
        since_s = run.truth.emission_time_s - run.plan.targets.ignition_s[target]
        for number, sensor in enumerate(run.sensors):
            own = data.where((data["sensor_id"] == sensor.id) & data["is_visible"])
            rows = np.flatnonzero((run.truth.target == target) & (run.detections.sensor == number))
            at = np.searchsorted(since_s[rows], own["since_ignition_s"])
            same = at < len(rows)
            same[same] = np.abs(since_s[rows][at[same]] - own["since_ignition_s"][same]) < 1e-9
            due = run.truth.probability[rows][at[same]]
            np.testing.assert_allclose(own["detection_probability"][same], due, atol=2e-3)
            strong = own["snr"][same] > 20.0
            if strong.any():
                measured = measured_in_reference_band(run, number, rows[at[same]])
                assert np.median(measured[strong] / own["snr"][same][strong]) == pytest.approx(
                    1.0, abs=0.02
                )
            found += int(same.sum())
    assert found > 100


@pytest.mark.slow
def test_the_air_is_clear_where_the_scene_has_none_and_thins_with_height() -> None:
    assert set(
        signals(RunFacts(example_run("photons", atmosphere="clear")), 0)["transmittance"].tolist()
    ) == {1.0}
    data = signals(RunFacts(example_run("photons")), 0)
    for name in set(data["sensor_id"].tolist()):
        own = data.where(data["sensor_id"] == name)
        assert own["transmittance"][0] < 0.7
        assert own["transmittance"][-1] == pytest.approx(1.0, abs=1e-3)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8), st.integers(1, 3), st.integers(0, 2))
def test_confirmed_detections_are_those_of_all_outcomes(
    chances: list[float], needed: int, more: int
) -> None:
    among = needed + more
    due = np.zeros(len(chances))
    for outcome in product((0, 1), repeat=len(chances)):
        weight = np.prod(
            [chance if hit else 1.0 - chance for chance, hit in zip(chances, outcome, strict=True)]
        )
        done = [
            sum(outcome[max(0, last - among + 1) : last + 1]) >= needed and outcome[last]
            for last in range(len(chances))
        ]
        due += weight * (np.cumsum(done) > 0)
    np.testing.assert_allclose(
        confirmed_by(np.array(chances), needed, among), due, rtol=0, atol=1e-12
    )


def test_latencies_are_those_of_the_summary_against_the_closed_form() -> None:
    run = example_run("first_light")
    (pair,) = pair_latencies(RunFacts(run))
    assert pair.observed_s == pytest.approx(run.summary["targets"][0]["latency_s"], abs=1e-9)
    sensor = run.sensors[0]
    time_s = np.linspace(0.0, 5.0, 50)
    light_s = run.truth.range_m[0] / 299_792_458.0
    period_s = sensor.scan.period_ns * 1e-9
    chance = sensor.detection_probability["ICBM"]
    np.testing.assert_allclose(
        pair.cdf(time_s), latency_cdf(time_s - light_s, period_s, chance, "random"), atol=1e-3
    )
    data = latency_curves([pair])
    assert data.where(data["series"] == "run")["latency_s"].tolist() == [pair.observed_s]
    curve = data.where(data["series"] == "closed form")["probability"]
    assert np.all(np.diff(curve) >= 0.0)
    assert curve[-1] > 0.99


def test_the_latencies_of_many_pairs_follow_the_closed_form() -> None:
    """Of 320 pairs the curves differ by less than 0.091 with a confidence of 99 % (Kolmogorov);
    each sensor's phase is its own, and ignitions fall anywhere in the scan periods."""
    target = {"type": "ICBM", "aim": {"lat_deg": 9.0, "lon_deg": 167.7}}
    launch = {"lat_deg": 34.73, "lon_deg": -120.57}
    targets = [
        {**target, "id": f"T{n}", "launch": {**launch, "time_s": 7.0 * (0.6180339887 * n % 1.0)}}
        for n in range(40)
    ]
    sensors = [
        {"model": "DSP", "id": f"S{n}", "orbital_slot_deg": -150.0 + 8.0 * n} for n in range(8)
    ]
    head = {**SCENE, "scene": "many", "duration_s": 30.0, "tracker": "none"}
    run = opir.simulate(opir.scene_from_mapping({**head, "sensors": sensors, "targets": targets}))
    pairs = pair_latencies(RunFacts(run))
    data = latency_curves(pairs)
    seen, curve = (data.where(data["series"] == name) for name in ("run", "closed form"))
    assert len(seen) == len(pairs) == 320
    due = np.interp(seen["latency_s"], curve["latency_s"], curve["probability"])
    assert np.abs(seen["probability"] - due).max() < 0.091


@pytest.mark.slow
def test_confidences_are_of_all_detections_of_launches() -> None:
    run = scored_run()
    data = confidences(RunFacts(run))
    own = run.truth.target >= 0
    assert data["detections"].sum() == np.count_nonzero(own)
    right = np.count_nonzero(
        run.detections.reported_type[own] == list(run.reported_types).index("ICBM")
    )
    assert (data["detections"] * data["type_right"]).sum() == pytest.approx(right)
    assert np.all((data["low"] <= data["median"]) & (data["median"] <= data["high"]))
    assert data["high"].max() <= run.detections.confidence.max()
    last_s = data["since_ignition_s"][-1] + run.plan.targets.ignition_s[0]
    in_force = np.flatnonzero((run.tracks.track == 0) & (run.tracks.tick_s <= last_s))[-1]
    assert data["track_type_probability"][-1] == pytest.approx(
        run.tracks.type_probability[in_force].max()
    )


@pytest.mark.slow
def test_regions_over_time_contain_what_they_contain() -> None:
    run = scored_run()
    data = region_history(RunFacts(run))
    truth = run.plan.targets.truth()[0]["impact"]
    place = np.radians([truth["lat_deg"], truth["lon_deg"]]).tolist()
    for row in np.linspace(0, len(data) - 1, 7).astype(int).tolist():
        (at,) = np.flatnonzero(run.tracks.tick_s == data["tick_s"][row])
        for region in run.tracks.impact_regions[at]:
            percent = round(100 * region.containment)
            assert data[f"contained_{percent}"][row] == region.contains(*place)
            assert data[f"area_{percent}_km2"][row] == region.area_km2


@pytest.mark.slow
def test_nees_is_the_error_over_the_covariance() -> None:
    run = scored_run()
    data = nees_history(RunFacts(run))
    row = len(data) // 2
    tick_s = data["since_ignition_s"][row] + run.plan.targets.ignition_s[0]
    (at,) = np.flatnonzero(np.abs(run.tracks.tick_s - tick_s) < 1e-6)
    error = (
        run.tracks.state[at]
        - true_states_ecef(run.plan, np.zeros(1, dtype=np.int32), np.array([tick_s]))[0]
    )
    assert data["position_error_m"][row] == pytest.approx(np.linalg.norm(error[:3]))
    if np.isnan(run.tracks.state_sigmas[at]).all():
        due = error @ np.linalg.inv(run.tracks.state_covariance[at]) @ error / 6.0
        assert data["nees_over_6"][row] == pytest.approx(due, rel=1e-6)


@pytest.mark.slow
def test_scores_are_those_of_the_command() -> None:
    run = scored_run()
    reported = scorecard_text({"imm": scorecard([evidence_of_run(run, run.plan)])})
    rows = dict(score_rows(RunFacts(run)))
    for label in (
        "launches tracked",
        "tracks per launch",
        "purity",
        "completeness",
        "GOSPA per target, m",
    ):
        line = next(line for line in reported.splitlines() if line.startswith(label))
        assert line.endswith(rows[label])
    assert rows["false tracks"] == "0"
    assert score_rows(RunFacts(empty_run())) == []


@pytest.mark.slow
def test_every_plot_draws_into_the_axes_that_it_was_given_or_says_why_not() -> None:
    for run in (scored_run(), empty_run(), example_run("photons")):
        plots = RunPlots(run)
        names = (
            "snr",
            "probability",
            "air",
            "confidence",
            "latency",
            "containment",
            "nees",
            "scorecard",
        )
        for name in names:
            _, axes = pyplot.subplots()
            assert getattr(plots, name)(ax=axes) is axes
            assert axes.texts or axes.lines or axes.patches or axes.tables
            pyplot.close()
