"""Conformance tests of signature, source, atmosphere and background models."""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import (
    EMITTER_TYPES,
    TARGET_TYPES,
    AtmosphereContext,
    AtmosphereModel,
    Background,
    BackgroundContext,
    BackgroundModel,
    Band,
    Paths,
    SignatureContext,
    SignatureModel,
    Signatures,
    SourceContext,
    SourceModel,
    Sources,
    Trajectories,
    Transmittance,
    Views,
)
from opir_testing.contracts.contract import (
    Contract,
    require,
    require_array_computation,
    require_equal,
    require_independent_rows,
    require_near,
    require_no_outside_inputs,
    require_pickling,
    require_rows,
    undefined,
)

_EPOCH_US = 1_775_044_800_000_000
_SEED = 20260401
_DURATION_S = 600.0
_BURN_S = 180.0
#: Sensors of bodies look at targets after burnout too.
_FOLLOWED_S = 220.0
_ROWS = 400
_SEEDED = "Draw random numbers from the seed of the context."


class RadiometricContract(Contract):
    """What conformance tests of radiometric models share; models are built with `bands`."""

    bands: ClassVar[Sequence[Band]] = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.2, 4.45))

    @classmethod
    def count(cls) -> int:
        """Return the number of things that the model describes; without any there is nothing to
        test.
        """
        return 1

    def values(self, band: int, rows: Any) -> FloatArray:
        """Return the values of the model for some rows."""
        raise undefined(
            type(self), "values(band, rows)", "the model's values (n,) for rows (n,) in a band"
        )

    def test_rows_are_computed_as_arrays(self) -> None:
        """The number of Python steps does not grow with the rows: computations are on arrays."""
        if self.count():
            require_array_computation(
                "row", lambda rows: self.values(0, _spread(rows)), _ROWS // 4, _ROWS
            )

    def test_clock_network_and_global_random_state_are_not_used(self) -> None:
        """Clock, entropy, environment, network and global random state are not used."""
        require_no_outside_inputs(self.use(), _SEEDED)

    def exercise(self) -> object:
        """Build the model and compute values."""
        return self.part() and self.count() and self.values(0, np.arange(_ROWS))


def _spread(rows: int) -> IntArray:
    """Return rows evenly over all, so that few take the same branches as many."""
    return np.linspace(0, _ROWS - 1, rows).astype(np.int64)


class EmitterContract(RadiometricContract):
    """Conformance tests of signature and source models."""

    @classmethod
    def signatures(cls) -> Signatures:
        """Return the built signatures."""
        raise undefined(cls, "signatures()", "the built signatures or sources")

    @classmethod
    def part(cls) -> Any:
        """Return the built signatures."""
        return cls.signatures()

    def values(self, band: int, rows: Any) -> FloatArray:
        """Return radiant intensities of some rows: each emitter at many times, heights and aspect
        angles.
        """
        row = np.arange(_ROWS)
        share = np.linspace(0.0, 1.0, _ROWS)
        columns = (
            (row % max(self.count(), 1)).astype(np.int32),
            share * _FOLLOWED_S,
            (share**2) * 400e3,
            np.pi * (row * 0.618 % 1.0),
        )
        return self.signatures().intensity_w_sr(band, *(column[rows] for column in columns))

    def test_intensities_are_finite_and_not_negative(self) -> None:
        """Radiant intensities are finite and not negative, at all aspect angles, from the ground to
        space.
        """
        for band in range(len(self.bands) if self.count() else 0):
            intensity = self.values(band, np.arange(_ROWS))
            require_rows("intensity_w_sr", intensity, _ROWS)
            require(
                np.all(np.isfinite(intensity)) and np.all(intensity >= 0.0),
                f"intensities are from {np.min(intensity)} to {np.max(intensity)}",
                "Return W/sr, 0 for no radiation, never nan.",
            )

    def test_intensities_are_independent(self) -> None:
        """The intensity of a row does not depend on the other rows of the call."""
        if self.count():
            require_independent_rows("intensity_w_sr", lambda rows: self.values(0, rows), _ROWS)

    def test_built_signatures_pickle(self) -> None:
        """The built signatures can be pickled."""
        require_pickling(self.signatures())


class SignatureContract(EmitterContract):
    """Conformance tests of a signature model, built for a target of each type."""

    kind = SignatureModel

    @classmethod
    def count(cls) -> int:
        """Return the number of targets."""
        return len(TARGET_TYPES)

    @classmethod
    @cache
    def signatures(cls) -> Signatures:
        """Return the built signatures."""
        count = len(TARGET_TYPES)
        context = SignatureContext(
            bands=tuple(cls.bands),
            ids=tuple(f"T{row}" for row in range(count)),
            paths=tuple(f"targets[{row}].signature" for row in range(count)),
            types=TARGET_TYPES,
            profiles=("",) * count,
            burn_time_s=np.full(count, _BURN_S),
        )
        return cls.built(Signatures, [cls.config()] * count, context)


class SourceContract(EmitterContract):
    """Conformance tests of a source model; `launched` is that of `SourceContext`, for one that
    follows launches.
    """

    kind = SourceModel
    launched: ClassVar[Callable[[str], tuple[Trajectories, int]] | None] = None

    @classmethod
    @cache
    def sources(cls) -> Sources:
        """Return the built sources."""
        context = SourceContext(
            bands=tuple(cls.bands),
            id="SUBJECT",
            path="sources[0]",
            epoch_us=_EPOCH_US,
            duration_s=_DURATION_S,
            seed=_SEED,
            launched=cls.launched,
        )
        return cls.built(Sources, cls.config(), context)

    @classmethod
    def part(cls) -> Any:
        """Return the built sources."""
        return cls.sources()

    @classmethod
    def signatures(cls) -> Signatures:
        """Return the sources' signatures."""
        return Signatures.adopt(cls.sources().signatures)

    @classmethod
    def count(cls) -> int:
        """Return the number of emitters."""
        return len(cls.sources().ids)

    def test_emitters_have_ids_of_their_block(self) -> None:
        """The ids of emitters are that of their block with numbers from 1: SUBJECT-1, SUBJECT-2."""
        ids = list(self.sources().ids)
        expected = [f"SUBJECT-{number}" for number in range(1, len(ids) + 1)]
        require(
            sorted(ids) == sorted(expected),
            f"ids are {ids[:3]}",
            "Number them from 1 after the block's id.",
        )

    def test_emitters_have_source_types(self) -> None:
        """Emitters have types of sources and one kind in truth and reports, a start before their
        end, and positions between them.
        """
        trajectories = self.sources().trajectories
        rows = len(self.sources().ids)
        require(
            trajectories.type_code.shape == (rows,)
            and bool(
                np.all(
                    (trajectories.type_code >= len(TARGET_TYPES))
                    & (trajectories.type_code < len(EMITTER_TYPES))
                )
            ),
            "an emitter has the type of a target",
            "Set type_code to EMITTER_TYPES.index of a source's type.",
        )
        names = [*trajectories.class_names]
        kinds = [row.get("type") for row in trajectories.truth()]
        require(
            names == kinds and len(names) == rows,
            f"class_names {names[:3]} are not the types {kinds[:3]} of the truth",
            "Name the kind of each emitter in both, or use a type of EMITTER_TYPES.",
        )
        require(
            np.all(trajectories.burnout_s > trajectories.ignition_s),
            "an emitter ends before it starts",
            "Check its times.",
        )
        middle = 0.5 * (trajectories.ignition_s + trajectories.burnout_s)
        position_m = trajectories.position_ecef_m(np.arange(rows, dtype=np.int32), middle)
        require(
            position_m.shape == (rows, 3) and bool(np.isfinite(position_m).all()),
            "an emitter has no position while it radiates",
            "Return (n, 3) that is finite between ignition_s and burnout_s.",
        )

    def test_emitters_are_at_their_places(self) -> None:
        """Emitters of a block with `lat_deg` and `lon_deg`, or with a list `at` of these, are
        there when they begin.
        """
        config = self.config()
        places = getattr(config, "at", None) or [config]
        trajectories = self.sources().trajectories
        if len(places) != self.count():
            return
        rows = np.arange(self.count(), dtype=np.int32)
        for row, position_m in enumerate(
            trajectories.position_ecef_m(rows, trajectories.ignition_s)
        ):
            place = {name: getattr(places[row], name, None) for name in ("lat_deg", "lon_deg")}
            require_near(f"emitter {row + 1} begins", position_m, place, "its place")


#: Above this height the atmosphere absorbs nothing.
_SPACE_M = 150e3


class EnvironmentContract(RadiometricContract):
    """Conformance tests of atmosphere and background models."""

    @classmethod
    def model(cls) -> Any:
        """Return the built model."""
        raise undefined(cls, "model()", "the built model")

    @classmethod
    def part(cls) -> Any:
        """Return the built model."""
        return cls.model()

    def test_rows_are_independent(self) -> None:
        """The values of a row do not depend on the other rows of the call."""
        for band in range(len(self.bands)):
            require_independent_rows("the value", partial(self.values, band), _ROWS)

    def test_a_model_built_again_returns_the_same(self) -> None:
        """A second model of the same context returns the same values; the model can be pickled."""
        values = self.values(0, np.arange(_ROWS))
        copy = type(self.__class__.__name__, (type(self),), {})()
        is_equal = np.array_equal(copy.values(0, np.arange(_ROWS)), values)
        require_equal(
            is_equal,
            "a second model returns other values",
            "Build the model from its configuration and context.",
        )
        require_pickling(self.model())


class AtmosphereContract(EnvironmentContract):
    """Conformance tests of an atmosphere model."""

    kind = AtmosphereModel

    @classmethod
    @cache
    def model(cls) -> Transmittance:
        """Return the built model."""
        context = AtmosphereContext(bands=tuple(cls.bands), path="atmosphere", seed=_SEED)
        return cls.built(Transmittance, cls.config(), context)

    def values(self, band: int, rows: Any) -> FloatArray:
        """Return the transmittances and cloud tops of some paths."""
        path = _paths(_heights_m()[rows], rows).freeze()
        pairs = (
            self.model().transmittance(band, path),
            self.model().cloud_top_m(path.target_ecef_m),
        )
        for column in pairs:
            require_rows("the value", column, len(path))
        return np.stack(pairs, axis=1)

    def test_transmittances_lie_in_the_unit_interval(self) -> None:
        """Transmittances lie in [0, 1] at all heights and elevations; cloud tops are finite or
        -inf.
        """
        for band in range(len(self.bands)):
            passed, top_m = self.values(band, np.arange(_ROWS)).T
            require(
                np.all((passed >= 0.0) & (passed <= 1.0)),
                f"transmittances are from {np.min(passed)} to {np.max(passed)}",
                "Return values in [0, 1], never nan, also for grazing paths (elevation_sine near"
                " 0).",
            )
            require(
                np.all(top_m < np.inf), "a cloud top is nan or inf", "Return -inf for no cloud."
            )

    def test_space_is_clear(self) -> None:
        """The transmittance to targets above the atmosphere is 1."""
        rows = np.arange(_ROWS)
        passed = self.model().transmittance(0, _paths(np.full(_ROWS, _SPACE_M), rows).freeze())
        require(
            np.all(passed > 0.999),
            f"from {_SPACE_M:.0f} m it is {passed.min():.3f}",
            "Return 1 there.",
        )

    def test_transmittance_does_not_decrease_with_height(self) -> None:
        """At one position and elevation, transmittance does not decrease with the target's
        height.
        """
        place = np.full(_ROWS, 17)
        passed = self.model().transmittance(0, _paths(np.sort(_heights_m()), place).freeze())
        drop = float(-np.diff(passed).min(initial=0.0))
        require(
            drop <= 1e-9,
            f"it decreases by {drop:.2e} with height",
            "Less air is above a higher target.",
        )


class BackgroundContract(EnvironmentContract):
    """Conformance tests of a background model."""

    kind = BackgroundModel

    @classmethod
    @cache
    def model(cls) -> Background:
        """Return the built model, behind the atmosphere `clear`."""
        bands = tuple(cls.bands)
        clear = cls.host().component(AtmosphereModel, "clear")
        sky = clear.build(
            clear.config(), AtmosphereContext(bands=bands, path="atmosphere", seed=_SEED)
        )
        # A partial, because a lambda would not pickle in models that keep `make_atmosphere`.
        context = BackgroundContext(
            bands=bands,
            path="background",
            epoch_us=_EPOCH_US,
            make_atmosphere=partial(_identity, sky),
        )
        return cls.built(Background, cls.config(), context)

    def values(self, band: int, rows: Any) -> FloatArray:
        """Return the radiances and clutter of some views."""
        view = _views()
        selected = view.take(rows).freeze()
        pairs = (
            self.model().radiance_w_m2_sr(band, selected),
            self.model().clutter_w_m2_sr(band, selected),
        )
        for column in pairs:
            require_rows("the value", column, len(selected))
        return np.stack(pairs, axis=1)

    def test_radiances_are_finite_and_not_negative(self) -> None:
        """Radiance and clutter are finite and not negative, by day and night, at the limb, in
        space.
        """
        for band in range(len(self.bands)):
            values = self.values(band, np.arange(_ROWS))
            require(
                np.all(np.isfinite(values)) and np.all(values >= 0.0),
                f"radiances and clutter are from {np.min(values)} to {np.max(values)}",
                "Return W/(m2 sr), never nan: height_m is inf for lines of sight that miss the"
                " Earth.",
            )

    def test_cold_space_is_dark(self) -> None:
        """Radiance and clutter are 0 on lines of sight that miss the Earth."""
        values = self.values(0, np.flatnonzero(np.isinf(_views().height_m)))
        require(np.all(values == 0.0), f"space has {np.max(values)} W/(m2 sr)", "Return 0 there.")

    def test_structure_goes_with_the_radiance(self) -> None:
        """Structured radiances equal the plain ones; their structure is finite and known."""
        model = self.model()
        view = _views()
        bands = range(len(self.bands))
        if not model.structures:
            return
        radiance, rms, number = model.structured_radiances_w_m2_sr(list(bands), view.freeze())
        plain = np.array([model.radiance_w_m2_sr(band, view) for band in bands])
        require(
            np.array_equal(radiance, plain),
            "the radiances differ",
            "Return those of radiance_w_m2_sr.",
        )
        require(
            np.all(np.isfinite(rms)) and np.all(rms >= 0.0),
            f"standard deviations are from {np.min(rms)} to {np.max(rms)}",
            "Return W/(m2 sr), never nan, 0 for space.",
        )
        require(
            np.all((number >= 0) & (number < len(model.structures))),
            f"numbers of structures are from {np.min(number)} to {np.max(number)}, of"
            f" {len(model.structures)}",
            "Return indices into structures.",
        )


def _identity(sky: Transmittance) -> Transmittance:
    return sky


def _heights_m() -> FloatArray:
    """Return heights (n,) from the ground to space, unsorted."""
    return np.concatenate(
        [[0.0, 1.0, 100e3, _SPACE_M, 1e6], np.linspace(0.0, 60e3, _ROWS - 5)[::-1]]
    )


def _positions(rows: Any) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes (n,), rad, with poles and antimeridian."""
    latitude = np.radians(np.linspace(-90.0, 90.0, _ROWS))[rows]
    return latitude, np.radians(np.arange(_ROWS) * 137.5 % 360.0 - 180.0)[rows]


def _paths(height_m: FloatArray, rows: Any) -> Paths:
    latitude, longitude = _positions(rows)
    elevation_sine = np.sin(np.linspace(0.0, np.pi / 2.0, _ROWS))[(np.asarray(rows) * 7) % _ROWS]
    target = geodetic_to_ecef(latitude, longitude, height_m)
    sensor = geodetic_to_ecef(latitude, longitude, np.full(len(height_m), 3.6e7))
    return Paths(height_m, elevation_sine, target, sensor, np.asarray(rows, dtype=np.float64))


def _views() -> Views:
    rows = np.arange(_ROWS)
    latitude, longitude = _positions(rows)
    height_m = np.where(rows % 5 == 4, np.inf, np.where(rows % 5 == 3, 20e3, 0.0))
    point = geodetic_to_ecef(latitude, longitude, np.where(np.isinf(height_m), 4e7, height_m))
    elevation_sine = np.where(height_m > 0.0, 0.0, np.sin(np.linspace(0.0, np.pi / 2.0, _ROWS)))
    down = -point / np.sqrt(np.square(point).sum(axis=1))[:, None]
    return Views(height_m, elevation_sine, np.cos(rows * 0.3), point, rows.astype(np.float64), down)
