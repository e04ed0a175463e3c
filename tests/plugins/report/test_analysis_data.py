"""Signals, latencies, confidences, regions and scores of reports, against the run and its truth."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, strategies as st
from matplotlib import pyplot
from opir_photons.detection import latency_cdf
from opir_report import RunPlots
from opir_report.plots.latency import confirmed_by
from opir_scoring import evidence_of_run, scorecard, scorecard_text, true_states_ecef
from reported_runs import empty_run, example_run, report_data, scored_run
from scored_scene import SCENE

import opir_core as opir
from opir_core.arrays import FloatArray, IntArray

PLOTS = (
    "map",
    "world",
    "timeline",
    "directing",
    "footprints",
    "impact",
    "snr",
    "probability",
    "air",
    "confidence",
    "latency",
    "delays",
    "containment",
    "nees",
    "scorecard",
)


def test_a_constant_model_has_its_probability_and_no_signal() -> None:
    run = example_run("first_light")
    plots = RunPlots(run)
    probability = np.concatenate([line.get_ydata() for line in plots.probability().lines])
    assert set(probability[np.isfinite(probability)]) == {
        run.sensors[0].detection_probability["ICBM"]
    }
    assert "no signal" in plots.snr().texts[0].get_text()
    assert "no signal" in plots.air().texts[0].get_text()


def reference_band_snr(run: opir.Run, sensor: int, rows: IntArray) -> FloatArray:
    """Return the SNR (n,) that detections of one sensor measured in its reference band; `snr` is of
    all bands.
    """
    plan = run.plan
    place = run.sensors[sensor].radiometer.reference
    pair = np.flatnonzero(
        (plan.pairs.sensor == sensor) & (plan.pairs.target == run.truth.target[rows[0]])
    )
    scan = run.detections.scan[rows]
    exposures = plan.look_geometry().exposures(np.repeat(pair, len(rows)), scan)
    irradiance_w_m2 = run.detections.band_irradiance_w_m2[rows, place]
    return irradiance_w_m2 / plan.detection.response(exposures).noise_w_m2[:, place]


@pytest.mark.slow
def test_signals_are_those_of_the_detections() -> None:
    run = example_run("photons")
    matches = 0
    for target, (number, sensor) in product((0, 1), enumerate(run.sensors)):
        data = report_data(run)[f"signal-{target + 1}"]
        looks = data[(data["sensor_id"] == sensor.id) & data["is_visible"]]
        rows = np.flatnonzero((run.truth.target == target) & (run.detections.sensor == number))
        since_s = run.truth.emission_time_s[rows] - run.plan.targets.ignition_s[target]
        place = np.searchsorted(since_s, looks["since_ignition_s"] - 1e-9)
        is_match = place < len(rows)
        is_match[is_match] &= (
            np.abs(since_s[place[is_match]] - looks["since_ignition_s"][is_match]) < 1e-9
        )
        looks = looks[is_match]
        rows = rows[place[is_match]]
        probability = run.truth.probability[rows]
        np.testing.assert_allclose(looks["detection_probability"], probability, atol=2e-3)
        is_strong = looks["snr"] > 20.0
        if is_strong.any():
            ratio = reference_band_snr(run, number, rows) / looks["snr"]
            assert np.median(ratio[is_strong]) == pytest.approx(1.0, abs=0.02)
        matches += len(rows)
    assert matches > 100


@pytest.mark.slow
def test_the_air_thins_with_height_and_may_be_clear() -> None:
    clear = report_data(example_run("photons", atmosphere="clear"))["signal-1"]
    assert set(clear["transmittance"].tolist()) == {1.0}
    data = report_data(example_run("photons"))["signal-1"]
    for name in set(data["sensor_id"]):
        transmittance = data["transmittance"][data["sensor_id"] == name]
        assert transmittance[0] < 0.7
        assert transmittance[-1] == pytest.approx(1.0, abs=1e-3)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8), st.integers(1, 3), st.integers(0, 2))
def test_confirmed_detections_are_those_of_all_outcomes(
    probability: list[float], needed: int, surplus: int
) -> None:
    looks = needed + surplus
    expected = np.zeros(len(probability))
    for outcome in product((0, 1), repeat=len(probability)):
        weight = np.prod(
            [p if hit else 1.0 - p for p, hit in zip(probability, outcome, strict=True)]
        )
        is_confirmed = [
            sum(outcome[max(0, look - looks + 1) : look + 1]) >= needed and outcome[look]
            for look in range(len(probability))
        ]
        expected += weight * (np.cumsum(is_confirmed) > 0)
    np.testing.assert_allclose(
        confirmed_by(np.array(probability), needed, looks), expected, rtol=0, atol=1e-12
    )


def test_a_latency_is_that_of_the_summary_and_the_closed_form() -> None:
    run = example_run("first_light")
    sensor = run.sensors[0]
    data = report_data(run)["latency"]
    (latency_s,) = data["latency_s"][data["series"] == "run"]
    assert latency_s == pytest.approx(run.summary["targets"][0]["latency_s"], abs=1e-9)
    curve = data[data["series"] == "closed form"]
    light_s = run.truth.range_m[0] / 299_792_458.0
    expected = latency_cdf(
        curve["latency_s"] - light_s,
        sensor.scan.period_ns * 1e-9,
        sensor.detection_probability["ICBM"],
        "random",
    )
    np.testing.assert_allclose(curve["probability"], expected, atol=1e-3)
    assert (np.diff(curve["probability"]) >= 0.0).all()
    assert curve["probability"][-1] > 0.99


def test_latencies_of_many_pairs_follow_the_closed_form() -> None:
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
    axes = RunPlots(run).latency()
    assert axes.get_title(loc="left").startswith("320 pairs")
    (curve,) = axes.lines
    (steps,) = axes.patches
    shares, edges_s, _ = steps.get_data()
    assert len(shares) == 321
    expected = np.interp(edges_s[1:-1], curve.get_xdata(), curve.get_ydata())
    assert np.abs(shares[1:] - expected).max() < 0.091


@pytest.mark.slow
def test_confidences_are_of_all_detections_of_launches() -> None:
    run = scored_run()
    data = report_data(run)["confidence"]
    is_launch = run.truth.target >= 0
    assert data["detections"].sum() == np.count_nonzero(is_launch)
    code = list(run.reported_types).index("ICBM")
    right = np.count_nonzero(run.detections.reported_type[is_launch] == code)
    assert (data["detections"] * data["type_right"]).sum() == pytest.approx(right)
    assert np.all((data["low"] <= data["median"]) & (data["median"] <= data["high"]))
    assert data["high"].max() <= run.detections.confidence.max()
    time_s = data["since_ignition_s"][-1] + run.plan.targets.ignition_s[0]
    row = np.flatnonzero((run.tracks.track == 0) & (run.tracks.tick_s <= time_s))[-1]
    assert data["track_type_probability"][-1] == pytest.approx(
        run.tracks.type_probability[row].max()
    )


@pytest.mark.slow
def test_regions_over_time_contain_the_impact() -> None:
    run = scored_run()
    data = report_data(run)["regions"]
    truth = run.plan.targets.truth()[0]["impact"]
    place = np.radians([truth["lat_deg"], truth["lon_deg"]]).tolist()
    for record in data[np.linspace(0, len(data) - 1, 7).astype(int)]:
        (row,) = np.flatnonzero(run.tracks.tick_s == record["tick_s"])
        for region in run.tracks.impact_regions[row]:
            percent = round(100 * region.containment)
            assert record[f"contained_{percent}"] == region.contains(*place)
            assert record[f"area_{percent}_km2"] == region.area_km2


@pytest.mark.slow
def test_nees_is_the_error_over_the_covariance() -> None:
    run = scored_run()
    data = report_data(run)["nees"]
    record = data[len(data) // 2]
    tick_s = record["since_ignition_s"] + run.plan.targets.ignition_s[0]
    (row,) = np.flatnonzero(np.abs(run.tracks.tick_s - tick_s) < 1e-6)
    (state,) = true_states_ecef(run.plan, np.zeros(1, dtype=np.int32), np.array([tick_s]))
    error = run.tracks.state[row] - state
    assert record["position_error_m"] == pytest.approx(np.linalg.norm(error[:3]))
    if np.isnan(run.tracks.state_sigmas[row]).all():
        nees = error @ np.linalg.inv(run.tracks.state_covariance[row]) @ error
        assert record["nees_over_6"] == pytest.approx(nees / 6.0, rel=1e-6)


@pytest.mark.slow
def test_scores_are_those_of_the_command() -> None:
    run = scored_run()
    lines = scorecard_text({"imm": scorecard([evidence_of_run(run, run.plan)])}).splitlines()
    (table,) = RunPlots(run).scorecard().tables
    cells = {key: cell.get_text().get_text() for key, cell in table.get_celld().items()}
    rows = {cells[row, 0]: cells[row, 1] for row, column in cells if column == 0}
    for label in (
        "launches tracked",
        "tracks per launch",
        "purity",
        "completeness",
        "GOSPA per target, m",
    ):
        line = next(line for line in lines if line.startswith(label))
        assert line.endswith(rows[label])
    assert rows["false tracks"] == "0"
    assert "no tracks" in RunPlots(empty_run()).scorecard().texts[0].get_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", PLOTS)
def test_every_plot_draws_into_its_axes_or_says_why_not(name: str) -> None:
    for run in (scored_run(), empty_run(), example_run("photons")):
        _, axes = pyplot.subplots()
        assert getattr(RunPlots(run), name)(ax=axes) is axes
        assert axes.texts or axes.lines or axes.patches or axes.tables
        assert isinstance(getattr(RunPlots(run), name)(), type(axes))
