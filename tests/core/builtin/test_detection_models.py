"""Detection models without radiometry: probabilities of pairs, confirming bands, and what is drawn
for them.
"""

import zlib

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, strategies as st
from scipy.stats import binom

from opir_core.builtin.configs import ConstantConfig
from opir_core.builtin.detection import always_detection, constant_detection, never_detection
from opir_core.errors import ModelError
from opir_core.interfaces.contexts import ModelContext, SensorContext
from opir_core.interfaces.records import Exposures
from opir_core.plugin import Band, NoConfig, ScanningSensorConfig, scanning_sensor
from opir_core.scene.scene import TARGET_TYPES


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


def context_of(sensors, types=TARGET_TYPES):
    codes = np.array([TARGET_TYPES.index(name) for name in types], dtype=np.uint8)
    return ModelContext(sensors=tuple(sensors), target_type_code=codes)


def looks(sensor, target):
    rows = len(sensor)
    nothing = np.empty(0)
    vectors = np.empty((0, 3))
    index = [np.asarray(values, dtype=np.int32) for values in (sensor, target)]
    return Exposures(
        np.zeros(rows),
        np.zeros(rows),
        np.zeros(rows, np.int64),
        *index,
        nothing,
        nothing,
        vectors,
        vectors,
    )


def test_constant_gives_each_sensors_probability_by_type():
    sensors = [
        a_sensor(),
        a_sensor(name="T", detection_probability={"ICBM": 0.3, "IRBM": 0.2, "SRBM": 0.1}),
    ]
    model = constant_detection(
        ConstantConfig(), context_of(sensors, ("SRBM", "ICBM", "ICBM", "IRBM"))
    )
    sensor = np.array([0, 0, 0, 0, 1, 1], np.int32)
    target = np.array([0, 1, 2, 3, 3, 0], np.int32)
    expected = [0.5, 0.8, 0.8, 0.7, 0.2, 0.1]
    assert model.pair_probability(sensor, target).tolist() == expected
    assert model.probability(looks(sensor, target)).tolist() == expected
    assert not model.needs_geometry


def test_without_band_confirmation_every_band_confirms_and_nothing_is_drawn():
    model = constant_detection(
        ConstantConfig(), context_of([a_sensor(1), a_sensor(3), a_sensor(8)])
    )
    exposures = looks([0, 1, 2, 1], [0, 0, 1, 2])
    rng = FakeDraws(exposures.sensor, exposures.target)
    measured = model.measure(exposures, rng)
    assert measured.bands.tolist() == [0b1, 0b111, 0xFF, 0b111]
    assert measured.bands.dtype == np.uint8
    assert np.isnan(measured.snr).all()
    assert rng.calls == []


def test_band_confirmation_0_leaves_the_first_band():
    model = constant_detection(ConstantConfig(band_confirmation=0.0), context_of([a_sensor(3)]))
    exposures = looks([0] * 5, [0] * 5)
    assert (
        model.measure(exposures, FakeDraws(exposures.sensor, exposures.target)).bands.tolist()
        == [1] * 5
    )


@given(st.integers(min_value=1, max_value=8), st.floats(min_value=0.0, max_value=1.0))
def test_at_least_one_band_confirms_and_none_that_the_sensor_lacks(count, band_confirmation):
    model = constant_detection(
        ConstantConfig(band_confirmation=band_confirmation), context_of([a_sensor(count)])
    )
    exposures = looks([0] * 9, [0, 1, 2] * 3)
    bands = model.measure(exposures, FakeDraws(exposures.sensor, exposures.target)).bands
    assert ((bands >= 1) & (bands < 1 << count)).all()


@pytest.mark.slow
@pytest.mark.parametrize("band_confirmation", [0.2, 0.6])
def test_bands_confirm_as_often_as_they_should(band_confirmation):
    rows = 20_000
    model = constant_detection(
        ConstantConfig(band_confirmation=band_confirmation),
        context_of([a_sensor(3)], ["ICBM"] * rows),
    )
    exposures = looks([0] * rows, range(rows))
    bands = model.measure(exposures, FakeDraws(exposures.sensor, exposures.target)).bands
    others = 1.0 - (1.0 - band_confirmation) ** 2
    chances = {
        0: band_confirmation + (1.0 - band_confirmation) * (1.0 - others),
        1: band_confirmation,
        2: band_confirmation,
    }
    for bit, chance in chances.items():
        low, high = binom.interval(0.999, rows, chance)
        assert low <= np.count_nonzero(bands >> bit & 1) <= high


def test_a_row_draws_the_same_whatever_else_is_in_the_scene():
    config = ConstantConfig(band_confirmation=0.5)
    few = context_of([a_sensor(2)])
    many = context_of([a_sensor(2), a_sensor(5), a_sensor(1)])
    alone = looks([0, 0, 0], [0, 1, 2])
    crowd = looks([1, 0, 2, 0, 1, 0], [0, 0, 1, 1, 2, 2])
    first = (
        constant_detection(config, few).measure(alone, FakeDraws(alone.sensor, alone.target)).bands
    )
    second = (
        constant_detection(config, many).measure(crowd, FakeDraws(crowd.sensor, crowd.target)).bands
    )
    assert first.tolist() == second[crowd.sensor == 0].tolist()


def test_as_many_words_are_drawn_as_the_sensors_have_bands():
    exposures = looks([0, 1, 0], [0, 0, 1])
    rng = FakeDraws(exposures.sensor, exposures.target)
    context = context_of([a_sensor(2), a_sensor(3), a_sensor(7)])
    constant_detection(ConstantConfig(band_confirmation=0.5), context).measure(exposures, rng)
    assert rng.calls == [("bands", 2), ("bands", 3)]


def test_a_missing_probability_is_said_before_the_run():
    sensor = a_sensor(name="DSP-1", detection_probability={"ICBM": 0.6})
    constant_detection(ConstantConfig(), context_of([sensor], ["ICBM"]))
    with pytest.raises(
        ModelError,
        match=r"DSP-1 \(X\) has no probability of detection for SRBM targets: give SRBM in",
    ):
        constant_detection(ConstantConfig(), context_of([sensor], ["ICBM", "SRBM"]))


@pytest.mark.parametrize("probability", [1.5, -0.1, float("nan"), "0.5", True])
def test_a_sensor_with_an_impossible_probability_is_refused(probability):
    sensor = evolve(a_sensor(name="DSP-1"), detection_probability={"ICBM": probability})
    with pytest.raises(ModelError, match=r"DSP-1 .* not in \[0, 1\]"):
        constant_detection(ConstantConfig(), context_of([sensor], ["ICBM"]))


def test_a_sensor_with_more_bands_than_a_mask_holds_is_refused():
    sensor = evolve(a_sensor(name="DSP-1"), bands=tuple(Band(f"B{n}", 1.0, 2.0) for n in range(9)))
    with pytest.raises(ModelError, match=r"DSP-1 .* has 9 bands; at most 8"):
        always_detection(NoConfig(), context_of([sensor]))


def test_always_and_never_need_no_probabilities():
    sensor = a_sensor(2, detection_probability={})
    exposures = looks([0, 0], [0, 2])
    always, never = (
        make(NoConfig(), context_of([sensor])) for make in (always_detection, never_detection)
    )
    assert always.pair_probability(exposures.sensor, exposures.target).tolist() == [1.0, 1.0]
    assert never.pair_probability(exposures.sensor, exposures.target).tolist() == [0.0, 0.0]
    rng = FakeDraws(exposures.sensor, exposures.target)
    assert always.measure(exposures, rng).bands.tolist() == [3, 3]
    assert never.measure(looks([], []), rng).bands.tolist() == []
    assert rng.calls == []


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan"), "all", True])
def test_band_confirmation_is_a_probability(value):
    with pytest.raises(ValueError, match=r"outside|not a"):
        ConstantConfig(band_confirmation=value)
