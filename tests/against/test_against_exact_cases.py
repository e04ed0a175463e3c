"""Every public function that takes numbers, in float64 against 40 digits (mpmath), at inputs drawn
and at those kept.

An error is held to (1 + condition number) times the unit roundoff, so that what the input loses is
not blamed on the formula. `python -m benchmarks.stability` draws thousands.
"""

import importlib

import numpy as np
import pytest
from exact_cases import every_bound, every_case, left_out
from exact_cases.measure import measured, row_text, searched

pytestmark = [pytest.mark.filterwarnings("error"), pytest.mark.slow]

PACKAGES = ("geometry", "flight", "orbits", "radiometry", "detection", "scoring")

#: Largest error over (1 + condition) u. Sums of dozens of terms and table look-ups come to 20.
BAR = 50.0
DRAWS = 12


@pytest.mark.parametrize("case", every_case(), ids=lambda case: case.name)
def test_no_digit_is_lost_that_the_input_does_not_lose(case):
    result = measured(case, np.random.default_rng(5), DRAWS)
    assert not result.raised, row_text(result.inputs, result.raised[0][0])
    assert result.scaled.max() <= BAR, row_text(result.inputs, result.worst)


@pytest.mark.parametrize("case", every_bound(), ids=lambda case: case.name)
def test_stated_bounds_hold(case):
    result = searched(case, np.random.default_rng(6), DRAWS)
    assert result.ratio.max() <= 1.0, row_text(result.inputs, result.worst)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_has_a_case_or_a_reason(package):
    of = {"radiometry": "opir_photons.", "detection": "opir_photons.", "scoring": "opir_"}.get(
        package, "opir_core."
    )
    module = importlib.import_module(f"{of}{package}")
    have = {case.name.partition(",")[0] for case in [*every_case(), *every_bound()]}
    public = {f"{package}.{name}" for name in module.__all__}
    reasons = {name for name in left_out() if name.startswith(f"{package}.")}
    assert public == (have & public) | reasons
    assert not have & reasons
    assert reasons <= public


#: Inputs at which functions once lost digits, by the case.
KEPT = {
    "radiometry.lambert_phase": (3.141592653589793, 3.141592653581903, 3.0, 3.1415926, 0.0),
    "radiometry.ensquared_energy, mean": (
        (0.0045003456825959, 6.9378718542651805e-06, 8.0),
        (1.0, 1e-4, 1.0),
    ),
    "radiometry.mean_shares, wide spots": ((6336.578001821523, 1.0), (9.0, 1.0)),
    "radiometry.structure_correlation": (
        (5e-324, 0.44580951924335765, 2.88367700005157),
        (1e-160, 1.0, 6.0),
        (1e-3, 1.0, 200.0),
    ),
    "detection.cfar_probability_of_detection": (
        (1.7299153526356048, 9.535131086748066, 49.0),
        (0.5, 12.0, 20.0),
    ),
    "detection.cfar_loss": ((8.45132688224833e-09, 10.0), (1e-3, 100.0)),
    "detection.latency_quantile": (
        (1.8523965903097244e-292, 14.078247462284425, 0.8097544677218037),
        (0.07319007239096598, 17.691585417046078, 2.2224538659901233e-259),
    ),
}


@pytest.mark.parametrize("name", sorted(KEPT))
def test_inputs_that_once_lost_digits(name):
    case = next(case for case in every_case() if case.name == name)
    columns = [
        np.array(column)
        for column in zip(
            *(row if isinstance(row, tuple) else (row,) for row in KEPT[name]), strict=True
        )
    ]
    result = measured(
        case._replace(draw=lambda rng, n: columns, share=1.0),
        np.random.default_rng(1),
        len(columns[0]),
    )
    assert not result.raised
    assert result.scaled.max() <= BAR, row_text(result.inputs, result.worst)


def test_correlation_at_infinity_and_of_no_number():
    from opir_photons.radiometry import structure_correlation

    assert structure_correlation([np.inf, np.nan], 1.0, 3.0).tolist()[0] == 0.0
    assert np.isnan(structure_correlation(np.nan, 1.0, 3.0))


def test_the_suns_place_does_not_go_through_one_double_of_a_julian_date():
    """A Julian date in one double moves in steps of 4e-5 s: of the Sun's place, 1 m."""
    from opir_core.geometry import sun_position_eci_m

    epoch = np.datetime64("2025-01-12T09:16:29.290008")
    times_s = np.arange(200) * 1e-6
    moved_m = np.diff(sun_position_eci_m(epoch, times_s)[:, 0])
    assert len(np.unique(np.round(moved_m, 6))) > 1
    assert np.abs(moved_m).max() < 0.1
