"""Detection models without radiometry: probabilities of pairs, confirming bands, and what is drawn
for them.
"""

import zlib

import numpy as np
import pytest
from attrs import evolve, fields
from core_components import built, context_of
from hypothesis import given, strategies as st
from scipy.stats import binom

from opir_core import ModelError
from opir_core.plugin import (
    TARGET_TYPES,
    Band,
    DetectionModel,
    Exposures,
    ScanningSensorConfig,
    SensorContext,
    scanning_sensor,
)


class FakeDraws:
    """Numbers that depend on a row's sensor and target, the purpose and the number of words; it
    counts its calls.
    """

    def __init__(self, sensor, target):
        self.pairs = list(zip(sensor.tolist(), target.tolist(), strict=True))
        self.calls = []

    def uniforms(self, purpose, words=1):
        self.calls.append((purpose, words))
        keys = [[zlib.crc32(purpose.encode()), words, *pair] for pair in self.pairs]
        return np.array([np.random.default_rng(key).random(words) for key in keys]).reshape(
            -1, words
        )

    def pair_uniforms(self, purpose, words=1):
        raise AssertionError("nothing is drawn by pair here")


def a_sensor(bands=2, name="S", **settings):
    config = ScanningSensorConfig(
        orbital_slot_deg=0.0,
        bands={f"B{number}": (1.0 + number, 2.0 + number) for number in range(bands)},
        scan_period_ms=100.0,
        **{"detection_probability": {"ICBM": 0.8, "IRBM": 0.7, "SRBM": 0.5}, **settings},
    )
    return scanning_sensor(config, SensorContext(id=name, epoch_us=0), type="X")


def looks(sensor, target):
    columns = {column.name: np.zeros(len(sensor)) for column in fields(Exposures)}
    index = {"sensor": np.array(sensor, np.int32), "target": np.array(target, np.int32)}
    return Exposures(**columns | index)


def constant(sensors, types=TARGET_TYPES, **settings):
    return built(DetectionModel, "constant", context_of(sensors, types), **settings)


def measured(model, exposures):
    """Return what a model measures, and its draws."""
    rng = FakeDraws(exposures.sensor, exposures.target)
    return model.measure(exposures, rng), rng.calls


def test_constant_gives_each_sensors_probability_by_type():
    weaker = a_sensor(name="T", detection_probability={"ICBM": 0.3, "IRBM": 0.2, "SRBM": 0.1})
    model = constant([a_sensor(), weaker], ("SRBM", "ICBM", "ICBM", "IRBM"))
    exposures = looks([0, 0, 0, 0, 1, 1], [0, 1, 2, 3, 3, 0])
    expected = [0.5, 0.8, 0.8, 0.7, 0.2, 0.1]
    assert model.pair_probability(exposures.sensor, exposures.target).tolist() == expected
    assert model.probability(exposures).tolist() == expected
    assert not model.needs_geometry


def test_by_default_every_band_confirms_and_nothing_is_drawn():
    model = constant([a_sensor(1), a_sensor(3), a_sensor(8)])
    values, calls = measured(model, looks([0, 1, 2, 1], [0, 0, 1, 2]))
    assert values.bands.tolist() == [0b1, 0b111, 0xFF, 0b111]
    assert values.bands.dtype == np.uint8
    assert np.isnan(values.snr).all()
    assert calls == []


def test_band_confirmation_0_leaves_the_first_band():
    model = constant([a_sensor(3)], band_confirmation=0.0)
    assert measured(model, looks([0] * 5, [0] * 5))[0].bands.tolist() == [1] * 5


@given(st.integers(min_value=1, max_value=8), st.floats(min_value=0.0, max_value=1.0))
def test_some_bands_of_the_sensor_confirm(count, band_confirmation):
    model = constant([a_sensor(count)], band_confirmation=band_confirmation)
    bands = measured(model, looks([0] * 9, [0, 1, 2] * 3))[0].bands
    assert ((bands >= 1) & (bands < 1 << count)).all()


@pytest.mark.slow
@pytest.mark.parametrize("p", [0.2, 0.6])
def test_bands_confirm_as_often_as_they_should(p):
    rows = 20_000
    model = constant([a_sensor(3)], ["ICBM"] * rows, band_confirmation=p)
    bands = measured(model, looks([0] * rows, range(rows)))[0].bands
    # The first band stands in where no band confirms.
    for bit, chance in enumerate((p + (1.0 - p) ** 3, p, p)):
        low, high = binom.interval(0.999, rows, chance)
        assert low <= np.count_nonzero(bands >> bit & 1) <= high


def test_a_row_draws_the_same_whatever_else_is_in_the_scene():
    model = constant([a_sensor(2)], band_confirmation=0.5)
    larger = constant([a_sensor(2), a_sensor(5), a_sensor(1)], band_confirmation=0.5)
    exposures = looks([1, 0, 2, 0, 1, 0], [0, 0, 1, 1, 2, 2])
    bands = measured(larger, exposures)[0].bands[exposures.sensor == 0]
    assert measured(model, looks([0, 0, 0], [0, 1, 2]))[0].bands.tolist() == bands.tolist()


def test_as_many_words_are_drawn_as_the_sensors_have_bands():
    model = constant([a_sensor(2), a_sensor(3), a_sensor(7)], band_confirmation=0.5)
    assert measured(model, looks([0, 1, 0], [0, 0, 1]))[1] == [("bands", 2), ("bands", 3)]


def test_a_missing_probability_is_said_before_the_run():
    sensor = a_sensor(name="DSP-1", detection_probability={"ICBM": 0.6})
    constant([sensor], ["ICBM"])
    words = r"DSP-1 \(X\) has no probability of detection for SRBM targets: give SRBM in"
    with pytest.raises(ModelError, match=words):
        constant([sensor], ["ICBM", "SRBM"])


@pytest.mark.parametrize("probability", [1.5, -0.1, float("nan"), "0.5", True])
def test_a_sensor_with_an_impossible_probability_is_refused(probability):
    sensor = evolve(a_sensor(name="DSP-1"), detection_probability={"ICBM": probability})
    with pytest.raises(ModelError, match=r"DSP-1 .* not in \[0, 1\]"):
        constant([sensor], ["ICBM"])


def test_a_sensor_with_more_bands_than_a_mask_holds_is_refused():
    sensor = evolve(a_sensor(name="DSP-1"), bands=tuple(Band(f"B{n}", 1.0, 2.0) for n in range(9)))
    with pytest.raises(ModelError, match=r"DSP-1 .* has 9 bands; at most 8"):
        built(DetectionModel, "always", context_of([sensor]))


@pytest.mark.parametrize(("name", "probability"), [("always", 1.0), ("never", 0.0)])
def test_always_and_never_need_no_probabilities(name, probability):
    model = built(DetectionModel, name, context_of([a_sensor(2, detection_probability={})]))
    exposures = looks([0, 0], [0, 2])
    pairs = exposures.sensor, exposures.target
    assert model.pair_probability(*pairs).tolist() == [probability] * 2
    values, calls = measured(model, exposures)
    assert values.bands.tolist() == [3, 3]
    assert measured(model, looks([], []))[0].bands.tolist() == calls == []


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan"), "all", True])
def test_band_confirmation_is_a_probability(value):
    with pytest.raises(ValueError, match=r"outside|not a"):
        constant([a_sensor()], band_confirmation=value)
