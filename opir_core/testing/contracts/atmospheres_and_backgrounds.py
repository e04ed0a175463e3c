"""The contracts of what lies between and behind: atmosphere and background models."""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import geodetic_to_ecef
from opir_core.interfaces.protocols import Band
from opir_core.interfaces.radiometric_models import (
    AtmosphereContext,
    Background,
    BackgroundContext,
    Paths,
    Transmittance,
    Views,
)
from opir_core.plugin.components import AtmosphereModel, BackgroundModel, Component
from opir_core.testing.contracts.comparisons import insist_pickles, insist_rows, insist_rows_stand_alone
from opir_core.testing.contracts.contract import Contract, insist
from opir_core.testing.steps import LOOP_STEPS, steps_per_row
from opir_core.testing.watching import asked_of_the_world

_EPOCH_US = 1_775_044_800_000_000
_SEED = 20260401
_ROWS = 400
#: Above this nothing of the air is left that a band could tell.
_SPACE_M = 150e3
_ALONE = "Compute whole columns at once."


class SkyContract(Contract):
    """What atmosphere and background models both promise; `bands` are those that they are built with."""

    bands: ClassVar[Sequence[Band]] = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.2, 4.45))

    @classmethod
    def model(cls) -> Any:
        """Return the built model."""
        raise NotImplementedError

    def answers(self, band: int, rows: Any) -> FloatArray:
        """Return what the model says of some rows, (n, answers)."""
        raise NotImplementedError

    def test_each_row_has_its_own_answer(self) -> None:
        """What is said of a row does not depend on which rows are asked about with it."""
        for band in range(len(self.bands)):
            insist_rows_stand_alone("the answer", partial(self.answers, band), _ROWS)

    def test_rows_are_not_worked_through_one_by_one(self) -> None:
        """More rows take no more steps of Python: the work is done on arrays."""
        steps = steps_per_row(lambda rows: self.answers(0, np.arange(rows)), _ROWS // 4, _ROWS)
        insist(steps < LOOP_STEPS, f"each row more takes {steps:.1f} steps of Python", _ALONE)

    def test_a_model_built_again_says_the_same(self) -> None:
        """A model built twice with one context says the same, and so does a pickled copy."""
        answers = self.answers(0, np.arange(_ROWS))
        again = type(self.__class__.__name__, (type(self),), {})()
        insist(np.array_equal(again.answers(0, np.arange(_ROWS)), answers), "built again, it says else", _ALONE)
        insist_pickles(self.model())

    def test_clock_network_and_global_random_numbers_are_not_asked(self) -> None:
        """Neither the clock, nor entropy, nor the network, nor random numbers that all share, are asked."""
        asked = asked_of_the_world(lambda: self.answers(0, np.arange(_ROWS)))
        insist(not asked, f"it asks {'; '.join(asked[:3])}", "Random numbers come from the context's seed.")


class AtmosphereContract(SkyContract):
    """What an atmosphere model promises."""

    kind: ClassVar[type[Component]] = AtmosphereModel

    @classmethod
    @cache
    def model(cls) -> Transmittance:
        """Return the built model."""
        context = AtmosphereContext(bands=tuple(cls.bands), path="atmosphere", seed=_SEED)
        made: Transmittance = cls.component().build(cls.config(), context)
        return made

    def answers(self, band: int, rows: Any) -> FloatArray:
        """Return transmittances and cloud tops of some paths."""
        path = _paths(_heights_m()[rows], rows).freeze()
        both = (self.model().transmittance(band, path), self.model().cloud_top_m(path.target_ecef_m))
        for values in both:
            insist_rows("the answer", values, len(path))
        return np.stack(both, axis=1)

    def test_transmittances_lie_in_the_unit_interval(self) -> None:
        """Transmittances lie in [0, 1], from the ground to space, at any elevation; cloud tops are finite or -inf."""
        for band in range(len(self.bands)):
            passed, top_m = self.answers(band, np.arange(_ROWS)).T
            insist(
                bool(np.all((passed >= 0.0) & (passed <= 1.0))),
                f"transmittances go from {np.min(passed)} to {np.max(passed)}",
                "Return values in [0, 1], never nan, also for grazing paths (elevation_sine near 0).",
            )
            insist(bool(np.all(top_m < np.inf)), "a cloud top is nan or inf", "Return -inf where there is no cloud.")

    def test_space_is_clear(self) -> None:
        """Targets above the atmosphere are seen as they are."""
        rows = np.arange(_ROWS)
        passed = self.model().transmittance(0, _paths(np.full(_ROWS, _SPACE_M), rows).freeze())
        insist(
            bool(np.all(passed > 0.999)), f"from {_SPACE_M:.0f} m {passed.min():.3f} gets through", "Return 1 there."
        )

    def test_higher_targets_are_seen_no_worse(self) -> None:
        """Of two targets over one place, with one elevation of the sensor, the higher is seen no worse."""
        place = np.full(_ROWS, 17)
        passed = self.model().transmittance(0, _paths(np.sort(_heights_m()), place).freeze())
        drop = float(-np.diff(passed).min(initial=0.0))
        insist(drop <= 1e-9, f"transmittance drops by {drop:.2e} with height", "Less air lies above a higher target.")


class BackgroundContract(SkyContract):
    """What a background model promises."""

    kind: ClassVar[type[Component]] = BackgroundModel

    @classmethod
    @cache
    def model(cls) -> Background:
        """Return the built model, before the atmosphere `clear`."""
        bands = tuple(cls.bands)
        clear = cls.host().component(AtmosphereModel, "clear")
        sky = clear.build(clear.config(), AtmosphereContext(bands=bands, path="atmosphere", seed=_SEED))
        # A partial pickles, where a lambda would not: models may keep what makes the atmosphere.
        context = BackgroundContext(
            bands=bands, path="background", epoch_us=_EPOCH_US, make_atmosphere=partial(_itself, sky)
        )
        made: Background = cls.component().build(cls.config(), context)
        return made

    def answers(self, band: int, rows: Any) -> FloatArray:
        """Return radiances and clutter of some views."""
        view = _views()
        chosen = view.take(rows).freeze()
        both = (self.model().radiance_w_m2_sr(band, chosen), self.model().clutter_w_m2_sr(band, chosen))
        for values in both:
            insist_rows("the answer", values, len(chosen))
        return np.stack(both, axis=1)

    def test_radiances_are_finite_and_not_negative(self) -> None:
        """Radiance and clutter are finite and not negative: by day and night, at the limb, in space."""
        for band in range(len(self.bands)):
            told = self.answers(band, np.arange(_ROWS))
            insist(
                bool(np.all(np.isfinite(told)) and np.all(told >= 0.0)),
                f"radiances and clutter go from {np.min(told)} to {np.max(told)}",
                "Return W/(m2 sr), never nan: height_m is inf where a line of sight leads away from the Earth.",
            )

    def test_cold_space_is_dark(self) -> None:
        """Lines of sight that lead away from the Earth see nothing."""
        told = self.answers(0, np.flatnonzero(np.isinf(_views().height_m)))
        insist(bool(np.all(told == 0.0)), f"cold space shines with {np.max(told)} W/(m2 sr)", "Return 0 there.")


def _itself(sky: Transmittance) -> Transmittance:
    return sky


def _heights_m() -> FloatArray:
    """Return heights (n,) from the ground to space, in no order."""
    return np.concatenate([[0.0, 1.0, 100e3, _SPACE_M, 1e6], np.linspace(0.0, 60e3, _ROWS - 5)[::-1]])


def _places(rows: Any) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes (n,), rad: poles and antimeridian among them."""
    latitude = np.radians(np.linspace(-90.0, 90.0, _ROWS))[rows]
    return latitude, np.radians(np.arange(_ROWS) * 137.5 % 360.0 - 180.0)[rows]


def _paths(height_m: FloatArray, rows: Any) -> Paths:
    latitude, longitude = _places(rows)
    elevation_sine = np.sin(np.linspace(0.0, np.pi / 2.0, _ROWS))[(np.asarray(rows) * 7) % _ROWS]
    target = geodetic_to_ecef(latitude, longitude, height_m)
    sensor = geodetic_to_ecef(latitude, longitude, np.full(len(height_m), 3.6e7))
    return Paths(height_m, elevation_sine, target, sensor, np.asarray(rows, dtype=np.float64))


def _views() -> Views:
    rows = np.arange(_ROWS)
    latitude, longitude = _places(rows)
    height_m = np.where(rows % 5 == 4, np.inf, np.where(rows % 5 == 3, 20e3, 0.0))
    point = geodetic_to_ecef(latitude, longitude, np.where(np.isinf(height_m), 4e7, height_m))
    seen_sine = np.where(height_m > 0.0, 0.0, np.sin(np.linspace(0.0, np.pi / 2.0, _ROWS)))
    return Views(height_m, seen_sine, np.cos(rows * 0.3), point, rows.astype(np.float64))
