"""Confidence: the paper's formula against its closed form, its bounds, and where it saturates."""

import math

import numpy as np
import pytest
from attrs import fields
from core_components import built
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent

from opir_core.plugin import ClassifierInputs, ConfidenceModel, ModelContext

CONTEXT = ModelContext(sensors=(), target_type_code=np.zeros(0, np.uint8))


def sightings(band_count, band_total, detection_count, elevation_rad):
    rows = len(band_count)
    columns = {column.name: np.zeros(rows) for column in fields(ClassifierInputs)}
    finite = np.where(np.isfinite(elevation_rad), elevation_rad, math.nan)
    return ClassifierInputs(
        **columns
        | {
            "elevation_sine": np.sin(finite),
            "band_count": np.array(band_count, dtype=np.int64),
            "band_total": np.array(band_total, dtype=np.int64),
            "detection_count": np.array(detection_count, dtype=np.int32),
        }
    )


def weighted(*columns, **weights):
    return built(ConfidenceModel, "weighted", CONTEXT, **weights).confidence(sightings(*columns))


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
    confidence = weighted(
        [band_count], [band_total], [detection_count], [math.radians(elevation_deg)]
    )
    assert confidence[0] == pytest.approx(expected, abs=1e-15)


def test_the_count_term_is_full_at_nine_detections_and_stays_so():
    counts = [*range(1, 13), 2**31 - 1]
    confidence = weighted([0] * 13, [1] * 13, counts, [0.0] * 13, band=0.0, count=1.0, geometry=0.0)
    assert confidence.tolist() == [min(1.0, math.log10(1 + n)) for n in counts]
    assert (np.diff(confidence[:9]) > 0).all()
    assert confidence[7] < 1.0
    assert confidence[8:].tolist() == [1.0] * 5


@st.composite
def weights(draw):
    low, high = sorted(draw(st.floats(min_value=0, max_value=1)) for _ in range(2))
    return {"band": low, "count": high - low, "geometry": 1.0 - high}


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
    confidence = weighted([band_count], [band_total], [detection_count], [elevation_rad], **weights)
    assert 0.0 <= confidence[0] <= 1.0


@given(
    st.integers(1, 8),
    st.integers(1, 1000),
    st.floats(min_value=-math.pi / 2, max_value=math.pi / 2),
)
def test_more_of_anything_is_never_less_confidence(bands, count, elevation_rad):
    higher = min(elevation_rad + 0.01, math.pi / 2)
    confidence = weighted(
        [bands, bands + 1, bands, bands],
        [9] * 4,
        [count, count, count + 1, count],
        [*[elevation_rad] * 3, higher],
    )
    assert (confidence >= confidence[0]).all()


def test_a_confidence_does_not_depend_on_the_rest_of_the_batch():
    rng = np.random.default_rng(5)
    bands = rng.integers(1, 4, 97), np.full(97, 3)
    columns = *bands, rng.integers(1, 50, 97), rng.uniform(-0.2, 1.5, 97)
    rows = [slice(row, row + 1) for row in range(97)]
    assert_rows_independent(lambda *some: (weighted(*some),), *columns, rows=rows)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"band": 0.5}, r"sum to 1.1, not to 1"),
        ({"band": -0.1, "count": 0.8}, r"outside \[0, 1\]"),
        ({"band": 0.4 + 2e-9}, "sum to 1.000000002, not to 1"),
        ({"band": float("nan")}, "not a finite number"),
    ],
)
def test_invalid_weights_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        built(ConfidenceModel, "weighted", CONTEXT, **settings)


def test_weights_that_sum_to_1_within_1e_9_are_taken():
    confidence = weighted([1], [1], [9], [math.pi / 2], band=0.4 + 5e-10)
    assert confidence[0] == 1.0


@pytest.mark.parametrize(("name", "confidence"), [("always", 1.0), ("never", 0.0)])
def test_the_null_models(name, confidence):
    model = built(ConfidenceModel, name, CONTEXT)
    rows = sightings([1, 2], [2, 2], [1, 5], [0.1, 0.2])
    assert model.confidence(rows).tolist() == [confidence] * 2
