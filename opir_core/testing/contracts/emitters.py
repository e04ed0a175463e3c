"""The contracts of what radiates: signature models and source models."""

from collections.abc import Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.interfaces.protocols import Band
from opir_core.interfaces.radiometric_models import SignatureContext, Signatures, SourceContext, Sources
from opir_core.plugin.components import Component, SignatureModel, SourceModel
from opir_core.scene.scene import EMITTER_TYPES, TARGET_TYPES
from opir_core.testing.contracts.comparisons import insist_pickles, insist_rows, insist_rows_stand_alone
from opir_core.testing.contracts.contract import Contract, insist
from opir_core.testing.steps import LOOP_STEPS, steps_per_row
from opir_core.testing.watching import asked_of_the_world

_EPOCH_US = 1_775_044_800_000_000
_SEED = 20260401
_DURATION_S = 600.0
_BURN_S = 180.0
_ROWS = 300


class EmitterContract(Contract):
    """What signature and source models both promise; `bands` are those that they are built with."""

    bands: ClassVar[Sequence[Band]] = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.2, 4.45))

    @classmethod
    def signatures(cls) -> Signatures:
        """Return the built signatures."""
        raise NotImplementedError

    @classmethod
    def count(cls) -> int:
        """Return how many emitters there are."""
        raise NotImplementedError

    def intensity(self, band: int, rows: Any) -> FloatArray:
        """Return radiant intensities of some rows: each emitter at many moments, heights and aspects."""
        row = np.arange(_ROWS)
        share = np.linspace(0.0, 1.0, _ROWS)
        columns = (
            (row % max(self.count(), 1)).astype(np.int32),
            share * _BURN_S,
            (share**2) * 400e3,
            np.pi * (row * 0.618 % 1.0),
        )
        return self.signatures().intensity_w_sr(band, *(column[rows] for column in columns))

    def test_intensities_are_finite_and_not_negative(self) -> None:
        """Radiant intensities are finite and not negative, from nose-on to tail-on, from the ground to space."""
        for band in range(len(self.bands) if self.count() else 0):
            told = self.intensity(band, np.arange(_ROWS))
            insist_rows("intensity_w_sr", told, _ROWS)
            insist(
                bool(np.all(np.isfinite(told)) and np.all(told >= 0.0)),
                f"intensities go from {np.min(told)} to {np.max(told)}",
                "Return W/sr, 0 where nothing radiates, never nan.",
            )

    def test_each_row_has_its_own_intensity(self) -> None:
        """The intensity of a row does not depend on which rows are asked about with it."""
        if self.count():
            insist_rows_stand_alone("intensity_w_sr", lambda rows: self.intensity(0, rows), _ROWS)

    def test_rows_are_not_worked_through_one_by_one(self) -> None:
        """More rows take no more steps of Python: the work is done on arrays."""
        if self.count():
            steps = steps_per_row(lambda rows: self.intensity(0, np.arange(rows)), _ROWS // 4, _ROWS)
            insist(steps < LOOP_STEPS, f"each row more takes {steps:.1f} steps of Python", "Compute whole columns.")

    def test_clock_network_and_global_random_numbers_are_not_asked(self) -> None:
        """Neither the clock, nor entropy, nor the network, nor random numbers that all share, are asked."""
        asked = asked_of_the_world(lambda: self.count() and self.intensity(0, np.arange(_ROWS)))
        insist(not asked, f"it asks {'; '.join(asked[:3])}", "Random numbers come from the context's seed.")

    def test_built_signatures_pickle(self) -> None:
        """The built signatures can be pickled."""
        insist_pickles(self.signatures())


class SignatureContract(EmitterContract):
    """What a signature model promises: built for a target of each type."""

    kind: ClassVar[type[Component]] = SignatureModel

    @classmethod
    def count(cls) -> int:
        """Return how many targets there are."""
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
        made: Signatures = cls.component().build([cls.config()] * count, context)
        return made


class SourceContract(EmitterContract):
    """What a source model promises."""

    kind: ClassVar[type[Component]] = SourceModel

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
        )
        made: Sources = cls.component().build(cls.config(), context)
        return made

    @classmethod
    def signatures(cls) -> Signatures:
        """Return the sources' signatures."""
        return cls.sources().signatures

    @classmethod
    def count(cls) -> int:
        """Return how many emitters there are."""
        return len(cls.sources().ids)

    def test_emitters_have_ids_of_their_block(self) -> None:
        """Emitters are called after their block, each once: SUBJECT-1, SUBJECT-2."""
        ids = list(self.sources().ids)
        due = [f"SUBJECT-{number}" for number in range(1, len(ids) + 1)]
        insist(sorted(ids) == sorted(due), f"emitters are called {ids[:3]}", "Number them from 1 after the block's id.")

    def test_emitters_are_no_targets(self) -> None:
        """Emitters have the type of sources, and shine for a time at a place."""
        made = self.sources().trajectories
        rows = len(self.sources().ids)
        insist(
            made.type_code.shape == (rows,)
            and bool(np.all((made.type_code >= len(TARGET_TYPES)) & (made.type_code < len(EMITTER_TYPES)))),
            "an emitter has the type of a target",
            "Set type_code to EMITTER_TYPES.index of a source's type.",
        )
        insist(bool(np.all(made.burnout_s > made.ignition_s)), "an emitter stops before it begins", "Check its times.")
        middle = 0.5 * (made.ignition_s + made.burnout_s)
        place_m = made.position_ecef_m(np.arange(rows, dtype=np.int32), middle)
        insist(
            place_m.shape == (rows, 3) and bool(np.isfinite(place_m).all()),
            "an emitter has no place while it shines",
            "Return (n, 3) that is finite between ignition_s and burnout_s.",
        )
