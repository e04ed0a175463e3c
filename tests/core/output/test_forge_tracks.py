"""The encoder `forge-tracks`: the event of `forge`, and in it what its track's tracker knew."""

import json
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from opir_testing import stub_estimates, stub_sensor, stub_window
from opir_testing.bench import encoder_of
from opir_testing.doubles import stub_hypotheses

import opir_core as opir
from opir_core import plan_windows
from opir_core.arrays import FloatArray
from opir_core.output import ForgeEncoder, detection_schema, time_texts
from opir_core.output.events.encoder_input import window_blocks
from opir_core.plugin import REPORTED_TYPES, EncoderContext, Window
from opir_core.scene import core_hypotheses

EPOCH_US = 1_775_044_800_000_000
HYPOTHESES = tuple(each.name for each in core_hypotheses())
CONTEXT = EncoderContext(sensors=(stub_sensor(),), epoch_us=EPOCH_US, hypotheses=HYPOTHESES)
PLACED = ForgeEncoder(CONTEXT, has_positions=True)
WITH_TRACKS = ForgeEncoder(CONTEXT, has_tracks=True)
VALIDATOR = jsonschema.Draft202012Validator(detection_schema(is_closed=True))
SUMS = ("track_probability_launch", "track_probability_missile", "track_probability_orbit")
WEIGHED = ("track_hypotheses", *SUMS, "track_probability_comes_down", "track_end")
ADDED = ("track_state", "burnout", "track_type_probability", *WEIGHED, "track_available_at")
ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)


def symmetric(terms: FloatArray) -> FloatArray:
    return np.tril(terms) + np.swapaxes(np.tril(terms, -1), -1, -2)


@st.composite
def windows(draw: st.DrawFn) -> Window:
    """Detections that point to any estimates, unknown and unlawful numbers included."""
    count = draw(st.integers(1, 6))
    rows = draw(st.integers(1, 4))
    columns = {
        "state": draw(arrays(np.float64, (rows, 6), elements=ANY)),
        "state_covariance": symmetric(draw(arrays(np.float64, (rows, 6, 6), elements=ANY))),
        "burnout": draw(arrays(np.float64, (rows, 7), elements=ANY)),
        "burnout_covariance": symmetric(draw(arrays(np.float64, (rows, 7, 7), elements=ANY))),
        "state_sigmas": draw(arrays(np.float64, (rows, 3), elements=ANY)),
        "available_s": draw(
            arrays(np.float64, rows, elements=st.floats(-1e6, 1e6) | st.just(np.nan))
        ),
        "type_probability": draw(
            arrays(np.float64, (rows, 4), elements=st.floats(0.0, 1.0) | st.just(np.nan))
        ),
    }
    # Where a track is comes out as nan unless it can be written: see the tests of the event's
    # place.
    columns["state"][
        ~np.isfinite(columns["state"]).all(axis=1) | (np.abs(columns["state"]) > 1e9).any(axis=1)
    ] = np.nan
    estimate = draw(arrays(np.int64, count, elements=st.integers(-1, rows - 1)))
    return stub_window(
        count, estimates=stub_estimates(rows, **columns), estimate=estimate, track=estimate
    )


def reported(state: FloatArray, time_s: float, covariance: FloatArray, document: Any) -> None:
    """Check a state against the columns it is reported from."""
    if not np.isfinite(state).all():
        assert document is None
        return
    assert document["position_ecef_m"] + document["velocity_ecef_m_s"] == pytest.approx(
        state, rel=1e-15, abs=5.001e-4
    )
    if abs(time_s) < 5e10:  # Some 1580 years: those between 1 and 9999 can be written.
        assert document["timestamp"].endswith("Z")
    elif not abs(time_s) < 3e11:
        assert document["timestamp"] is None
    lower = covariance[np.tril_indices(len(covariance))]
    assert document["covariance_ecef"] == (lower.tolist() if np.isfinite(lower).all() else None)


@given(windows())
def test_an_event_says_what_its_track_knew(window: Window) -> None:
    lines = WITH_TRACKS.encode(window).splitlines()
    plain = PLACED.encode(window).splitlines()
    estimates = window.estimates
    for line, without, row in zip(lines, plain, window.detections.estimate.tolist(), strict=True):
        event = json.loads(line)
        VALIDATOR.validate(event)
        state, burnout, types, *weighed, available = (event.pop(name) for name in ADDED)
        assert event == json.loads(without)
        if row < 0:
            assert (state, burnout, types, available, weighed) == (
                None,
                None,
                None,
                None,
                [None] * 6,
            )
            continue
        assert available == time_texts(estimates.available_s[row : row + 1], EPOCH_US)[0]
        reported(
            estimates.state[row], estimates.tick_s[row], estimates.state_covariance[row], state
        )
        radii = estimates.state_sigmas[row]
        if state is not None:
            assert state["ellipsoid_sigmas"] == (
                radii.tolist() if np.isfinite(radii).all() else None
            )
        assert burnout is None or burnout["ellipsoid_sigmas"] is None
        reported(
            estimates.burnout[row, :6],
            estimates.burnout[row, 6],
            estimates.burnout_covariance[row],
            burnout,
        )
        shares = estimates.type_probability[row]
        if np.isfinite(shares).all():
            assert list(types) == list(REPORTED_TYPES)
            assert list(types.values()) == pytest.approx(shares.tolist(), abs=5.001e-7)
        else:
            assert types is None


def test_an_event_says_what_its_track_may_be_and_how_it_ended() -> None:
    fire = stub_hypotheses(ground_source=0.75, SRBM=0.125)
    boost = stub_hypotheses(ICBM=0.25, SLV=0.5)
    estimates = stub_estimates(
        3, hypothesis_probability=[fire, boost, np.full_like(fire, np.nan)], end=[3, 0, 1]
    )
    window = stub_window(3, estimates=estimates, estimate=np.arange(3), track=np.arange(3))
    first_value, second, third = (
        json.loads(line) for line in WITH_TRACKS.encode(window).splitlines()
    )
    for event in (first_value, second, third):
        VALIDATOR.validate(event)
    assert list(first_value["track_hypotheses"]) == list(HYPOTHESES)
    assert {name: share for name, share in first_value["track_hypotheses"].items() if share} == {
        "ground source": 0.75, "SRBM": 0.125, "none of these": 0.125,
    }  # fmt: skip
    assert [[event[name] for name in SUMS] for event in (first_value, second)] == [
        [0.125, 0.125, 0.0],
        [0.75, 0.25, 0.5],
    ]
    assert [event["track_end"] for event in (first_value, second, third)] == [
        "lost",
        None,
        "impact",
    ]
    assert [third[name] for name in ("track_hypotheses", *SUMS)] == [None] * 4


@given(windows(), st.integers(1, 4))
def test_bytes_do_not_depend_on_how_detections_are_cut(window: Window, rows: int) -> None:
    pieces = [WITH_TRACKS.encode(window_block) for window_block in window_blocks(window, rows)]
    assert b"".join(pieces) == WITH_TRACKS.encode(window)


@pytest.mark.slow
@pytest.mark.parametrize(
    "tracker",
    [
        "imm",
        pytest.param("kepler-arc", marks=pytest.mark.slow),
        "none",
    ],
)
def test_the_events_of_a_scene_have_what_the_run_s_tracks_have(tracker: str) -> None:
    changes = ["duration_s=90", "outputs=[]", f"tracker={tracker}"]
    plan = opir.compile_plan(opir.load_scene("examples/first_light.yaml", overrides=changes))
    lines = b"".join(
        encoder_of(plan, "forge-tracks").encode(window) for window in plan_windows(plan)
    )
    events = [json.loads(line) for line in lines.splitlines()]
    run = opir.simulate(plan.scene)
    assert len(events) == len(run.detections) > 100
    tracked = 0
    for event, row in zip(events, run.detections.estimate.tolist(), strict=True):
        VALIDATOR.validate(event)
        assert set(ADDED) <= set(event)
        if row < 0:
            assert [event[name] for name in ADDED] == [None] * len(ADDED)
            continue
        tracked += 1
        reported(
            run.estimates.state[row], 0.0, run.estimates.state_covariance[row], event["track_state"]
        )
        burnout = run.estimates.burnout[row]
        covariance = run.estimates.burnout_covariance[row]
        reported(burnout[:6], burnout[6], covariance, event["burnout"])
    assert (tracked > 100) == (tracker != "none")


def test_covariances_read_back_stay_positive() -> None:
    """Also one that rounding would spoil: condition 1e15."""
    axes = np.linalg.qr(np.random.default_rng(3).normal(size=(6, 6)))[0]
    covariance = symmetric(axes @ np.diag(10.0 ** np.linspace(-3.0, 12.0, 6)) @ axes.T)
    window = stub_window(
        1, estimates=stub_estimates(1, state=7e6, state_covariance=covariance), estimate=0, track=0
    )
    lower = np.zeros((6, 6))
    lower[np.tril_indices(6)] = json.loads(WITH_TRACKS.encode(window))["track_state"][
        "covariance_ecef"
    ]
    assert np.array_equal(symmetric(lower), covariance)
