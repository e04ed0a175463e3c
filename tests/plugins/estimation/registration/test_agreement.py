"""How often a sensor sees what others see: sums of plain slices, and when it contradicts them."""

import numpy as np
import pytest
from opir_estimation.registration.agreement import Agreement

CHANCE = 0.8


def after_slices(slices, chance, looks, seen):
    """Return the sums after slices of one target with `looks` (s,) of sensors, each a detection."""
    agreement = Agreement.of(len(looks))
    on_target = np.array([looks], dtype=float) * np.array(seen)
    for _ in range(slices):
        agreement = agreement.after(
            on_target, np.array(looks, dtype=float), np.array([seen]), np.array([chance])
        )
    return agreement


def test_a_sensor_that_misses_what_two_others_see_contradicts_them():
    agreement = after_slices(40, [CHANCE] * 3, [1, 1, 1], [False, True, True])
    assert agreement.contradicts.tolist() == [True, False, False]
    assert agreement.expected.tolist() == pytest.approx([40 * CHANCE, 0.0, 0.0])
    assert agreement.shared.tolist() == [0.0, 0.0, 0.0]
    assert agreement.alone[0] == 40.0


def test_one_other_sensor_is_no_majority():
    assert not after_slices(400, [CHANCE] * 2, [1, 1], [False, True]).contradicts.any()


def test_a_sensor_out_of_whose_view_the_target_is_contradicts_nobody():
    agreement = after_slices(400, [0.0, CHANCE, CHANCE], [1, 1, 1], [False, True, True])
    assert not agreement.contradicts.any()


@pytest.mark.parametrize("seed", range(4))
def test_a_sensor_that_sees_half_of_its_chances_does_not_contradict(seed):
    rng = np.random.default_rng(seed)
    agreement = Agreement.of(3)
    for _ in range(200):
        looks = (rng.random((1, 3)) < [0.5 * CHANCE, CHANCE, CHANCE]).astype(float)
        chance = np.full((1, 3), CHANCE)
        agreement = agreement.after(looks, looks[0], np.ones((1, 3), dtype=bool), chance)
        assert not agreement.contradicts.any()


def test_a_mended_sensor_is_believed_again():
    agreement = after_slices(60, [CHANCE] * 3, [1, 1, 1], [False, True, True])
    assert agreement.contradicts[0]
    for _ in range(60):
        agreement = agreement.faded(1.0).after(
            np.ones((1, 3)), np.ones(3), np.ones((1, 3), dtype=bool), np.full((1, 3), CHANCE)
        )
    assert not agreement.contradicts.any()
