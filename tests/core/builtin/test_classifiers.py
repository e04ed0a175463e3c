"""Classifiers: draws from confusion matrices, overrides, complaints, and the null models."""

import numpy as np
import pytest
from attrs import evolve, fields
from core_components import built, context_of
from hypothesis import given, strategies as st
from scipy.stats import binom

from opir_core import ModelError
from opir_core.plugin import (
    REPORTED_TYPES,
    TARGET_TYPES,
    ClassifierInputs,
    ClassifierModel,
    ScanningSensorConfig,
    SensorContext,
    scanning_sensor,
)
from opir_core.scene import UNKNOWN_TYPE

MATRIX = {
    "ICBM": {"ICBM": 0.7, "IRBM": 0.1, "SRBM": 0.05, "UNKNOWN": 0.15},
    "IRBM": {"IRBM": 0.5, "UNKNOWN": 0.5},
    "SRBM": {"SRBM": 1.0},
}


class FakeDraws:
    """The numbers it was given, one a row."""

    def __init__(self, numbers):
        self.numbers = np.asarray(numbers, dtype=np.float64)

    def uniforms(self, purpose, words=1):
        raise AssertionError("a classification is drawn once for all scans of a pair")

    def pair_uniforms(self, purpose, words=1):
        assert (purpose, words) == ("classification", 1)
        return self.numbers[:, None]


def a_sensor(confusion=MATRIX, name="S", type_name="X"):
    config = ScanningSensorConfig(
        orbital_slot_deg=0.0,
        bands={"SWIR": (2.5, 3.0)},
        scan_period_ms=100.0,
        detection_probability={},
        confusion=confusion,
    )
    return scanning_sensor(config, SensorContext(id=name, epoch_us=0), type=type_name)


def sightings_of(sensor, target):
    rows = len(sensor)
    columns = {column.name: np.zeros(rows) for column in fields(ClassifierInputs)}
    index = {"sensor": np.array(sensor, np.int32), "target": np.array(target, np.int32)}
    return ClassifierInputs(**columns | index)


def reported(classifier, sensor, target, numbers):
    codes = classifier.reported_type(sightings_of(sensor, target), FakeDraws(numbers))
    assert codes.dtype == np.uint8
    return [REPORTED_TYPES[code] for code in codes]


@pytest.mark.parametrize(
    ("true_type_name", "number", "answer"),
    [
        ("ICBM", 0.0, "ICBM"),
        ("ICBM", 0.6999, "ICBM"),
        ("ICBM", 0.7001, "IRBM"),
        ("ICBM", 0.8001, "SRBM"),
        ("ICBM", 0.8501, "UNKNOWN"),
        ("IRBM", 0.0, "IRBM"),
        ("IRBM", 0.5001, "UNKNOWN"),
        ("SRBM", 0.0, "SRBM"),
        ("SRBM", 1.0 - 2**-53, "SRBM"),
    ],
)
def test_a_draw_falls_into_the_row_of_the_true_type(true_type_name, number, answer):
    classifier = built(ClassifierModel, "paper", context_of([a_sensor()]))
    assert reported(classifier, [0], [TARGET_TYPES.index(true_type_name)], [number]) == [answer]


@pytest.mark.parametrize("true_type_name", TARGET_TYPES)
def test_types_are_reported_as_often_as_the_matrix_says(true_type_name):
    rows = 40_000
    classifier = built(ClassifierModel, "paper", context_of([a_sensor()]))
    numbers = np.random.default_rng([11, len(true_type_name)]).random(rows)
    target = [TARGET_TYPES.index(true_type_name)] * rows
    codes = classifier.reported_type(sightings_of([0] * rows, target), FakeDraws(numbers))
    for code, name in enumerate(REPORTED_TYPES):
        low, high = binom.interval(0.999, rows, MATRIX[true_type_name].get(name, 0.0))
        assert low <= np.count_nonzero(codes == code) <= high


@st.composite
def rows_of_confusion(draw):
    names = draw(st.lists(st.sampled_from(REPORTED_TYPES), min_size=1, max_size=4, unique=True))
    weights = [draw(st.floats(min_value=0.001, max_value=1.0)) for _ in names]
    return {name: weight / sum(weights) for name, weight in zip(names, weights, strict=True)}


@given(rows_of_confusion(), st.floats(min_value=0.0, max_value=1.0, exclude_max=True))
def test_no_type_without_a_probability_is_ever_reported(row, number):
    context = context_of([a_sensor({"ICBM": row})], ["ICBM"])
    classifier = built(ClassifierModel, "paper", context)
    for drawn in (number, 0.0, 1.0 - 2**-53):
        assert row[reported(classifier, [0], [0], [drawn])[0]] > 0.0


def test_matrices_are_per_sensor_and_overridden_by_row():
    sensors = [
        a_sensor(type_name="A"),
        a_sensor({"ICBM": {"SRBM": 1.0}, "SRBM": {"ICBM": 1.0}}, type_name="B"),
    ]
    matrices = {"B": {"ICBM": {"IRBM": 1.0}}}
    context = context_of(sensors, ["ICBM", "SRBM"])
    classifier = built(ClassifierModel, "paper", context, matrices=matrices)
    assert reported(classifier, [0, 1, 0, 1], [0, 0, 1, 1], [0.0] * 4) == [
        "ICBM",
        "IRBM",
        "SRBM",
        "ICBM",
    ]


def test_a_sensor_without_a_row_is_reported_what_to_do():
    sensors = [a_sensor({"ICBM": {"ICBM": 1.0}}, name="X-7", type_name="SPY")]
    built(ClassifierModel, "paper", context_of(sensors, ["ICBM"]))
    with pytest.raises(
        ModelError, match=r"X-7 \(SPY\).*IRBM.*confusion.*matrices\.SPY.*classification: none"
    ):
        built(ClassifierModel, "paper", context_of(sensors, ["IRBM"]))


def test_a_row_that_a_plugin_got_wrong_is_refused():
    sensor = evolve(a_sensor(name="X-7"), confusion={"ICBM": {"ICBM": 0.5}})
    with pytest.raises(ModelError, match=r"X-7 .* sums to 0\.5"):
        built(ClassifierModel, "paper", context_of([sensor], ["ICBM"]))


def test_a_matrix_for_an_absent_sensor_type_is_refused():
    matrices = {"DPS": {"ICBM": {"IRBM": 1.0}}}
    sensors = [a_sensor(name="S-1", type_name="DSP"), a_sensor(name="S-2", type_name="LEO")]
    with pytest.raises(ModelError) as error:
        built(ClassifierModel, "paper", context_of(sensors, ["ICBM"]), matrices=matrices)
    assert str(error.value) == (
        "classification: matrices.DPS is for sensors of type DPS, and the scene has none; the"
        " nearest is 'DSP';"
        " the scene's sensors are of type DSP, LEO"
    )


def test_matrices_are_checked_when_they_are_read():
    with pytest.raises(ValueError, match=r"DSP: ICBM: the row sums to 0\.6"):
        built(ClassifierModel, "paper", None, matrices={"DSP": {"ICBM": {"ICBM": 0.6}}})


@pytest.mark.parametrize(
    ("name", "codes"),
    [("always", [2, 0, 1]), ("none", [UNKNOWN_TYPE] * 3), ("never", [UNKNOWN_TYPE] * 3)],
)
def test_the_null_classifiers(name, codes):
    classifier = built(ClassifierModel, name, context_of([a_sensor({})]))
    sightings = sightings_of([0, 0, 0], [2, 0, 1])
    assert classifier.reported_type(sightings, FakeDraws([])).tolist() == codes
