"""Confidence: the paper's formula against its closed form, its bounds, and where it saturates."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from opir_core.builtin.classification import full_confidence, no_confidence, weighted_confidence
from opir_core.builtin.configs import WeightedConfig
from opir_core.plugin import ClassifierInputs, ModelContext, NoConfig

CONTEXT = ModelContext(sensors=(), target_type_code=np.zeros(0, np.uint8))


def sightings(band_count, band_total, detection_count, elevation_rad):
    rows = len(band_count)
    index = np.zeros(rows, np.int32)
    floats = np.zeros(rows)
    return ClassifierInputs(
        time_s=floats,
        sensor=index,
        target=index,
        range_m=floats,
        elevation_sine=np.array(
            [math.sin(angle) if math.isfinite(angle) else math.nan for angle in elevation_rad]
        ),
        bands=np.zeros(rows, np.uint8),
        band_count=np.array(band_count, dtype=np.int64),
        band_total=np.array(band_total, dtype=np.int64),
        detection_count=np.array(detection_count, dtype=np.int32),
        snr=floats,
        band_irradiance_w_m2=np.empty((rows, 0)),
    )


def weighted(*columns, **weights):
    return weighted_confidence(WeightedConfig(**weights), CONTEXT).confidence(sightings(*columns))


@pytest.mark.parametrize(
    ("band_count", "band_total", "detection_count", "elevation_deg", "expected"),
    [
        (1, 1, 9, 90.0, 1.0),
        (2, 2, 1, 30.0, 0.4 + 0.3 * math.log10(2.0) + 0.3 * 0.5),
        (1, 2, 1, 0.0, 0.2 + 0.3 * math.log10(2.0)),
        (2, 3, 4, 45.0, 0.8 / 3.0 + 0.3 * math.log10(5.0) + 0.3 * math.sqrt(0.5)),
        (3, 3, 1000, -10.0, 0.7),
    ],
)
def test_the_papers_formula(band_count, band_total, detection_count, elevation_deg, expected):
    found = weighted([band_count], [band_total], [detection_count], [math.radians(elevation_deg)])
    assert found[0] == pytest.approx(expected, abs=1e-15)


def test_the_count_term_is_full_at_nine_detections_and_stays_so():
    counts = [*range(1, 13), 2**31 - 1]
    found = weighted([0] * 13, [1] * 13, counts, [0.0] * 13, band=0.0, count=1.0, geometry=0.0)
    assert found.tolist() == [min(1.0, math.log10(1 + n)) for n in counts]
    assert (np.diff(found[:9]) > 0).all()
    assert found[7] < 1.0
    assert found[8:].tolist() == [1.0] * 5


@st.composite
def weights(draw):
    first, second = sorted(
        (draw(st.floats(min_value=0, max_value=1)), draw(st.floats(min_value=0, max_value=1)))
    )
    return {"band": first, "count": second - first, "geometry": 1.0 - second}


@given(
    weights(),
    st.integers(-5, 300),
    st.integers(-5, 300),
    st.integers(-(2**31), 2**31 - 1),
    st.floats(allow_nan=True, allow_infinity=True),
)
def test_confidence_is_in_0_to_1_for_every_input(
    weights, band_count, band_total, detection_count, elevation_rad
):
    found = weighted([band_count], [band_total], [detection_count], [elevation_rad], **weights)
    assert 0.0 <= found[0] <= 1.0


@given(
    st.integers(1, 8),
    st.integers(1, 1000),
    st.floats(min_value=-math.pi / 2, max_value=math.pi / 2),
)
def test_more_of_anything_is_never_less_confidence(bands, count, elevation_rad):
    here = weighted([bands], [9], [count], [elevation_rad])
    for more in (
        ([bands + 1], [9], [count], [elevation_rad]),
        ([bands], [9], [count + 1], [elevation_rad]),
    ):
        assert weighted(*more)[0] >= here[0]
    higher = min(elevation_rad + 0.01, math.pi / 2)
    assert weighted([bands], [9], [count], [higher])[0] >= here[0]


def test_a_confidence_does_not_depend_on_the_rest_of_the_batch():
    rng = np.random.default_rng(5)
    columns = [
        rng.integers(1, 4, 97),
        np.full(97, 3),
        rng.integers(1, 50, 97),
        rng.uniform(-0.2, 1.5, 97),
    ]
    whole = weighted(*columns)
    alone = [weighted(*([column[row]] for column in columns))[0] for row in range(97)]
    assert whole.tolist() == alone


@pytest.mark.parametrize(
    ("given_weights", "words"),
    [
        ({"band": 0.5}, r"sum to 1.1, not to 1"),
        ({"band": -0.1, "count": 0.8}, r"outside \[0, 1\]"),
        ({"band": 0.4 + 2e-9}, "sum to 1.000000002, not to 1"),
        ({"band": float("nan")}, "not a finite number"),
    ],
)
def test_weights_that_are_none_are_refused(given_weights, words):
    with pytest.raises(ValueError, match=words):
        WeightedConfig(**given_weights)


def test_weights_that_sum_to_1_within_1e_9_are_taken():
    found = weighted([1], [1], [9], [math.pi / 2], band=0.4 + 5e-10)
    assert found[0] == 1.0


def test_the_null_models():
    rows = sightings([1, 2], [2, 2], [1, 5], [0.1, 0.2])
    assert full_confidence(NoConfig(), CONTEXT).confidence(rows).tolist() == [1.0, 1.0]
    assert no_confidence(NoConfig(), CONTEXT).confidence(rows).tolist() == [0.0, 0.0]
