"""Trajectories of sources that move: an ephemeris, for as long as they shine."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.flight import Ephemeris
from opir_core.plugin import EMITTER_TYPES, Signatures, SourceContext, Sources, Trajectories
from opir_photons.radiometry.emitters import Emitters, uniforms
from opir_photons.radiometry.sources import EmitterSources, truth_of


@frozen(eq=False)
class MovingTrajectories(Trajectories):
    """Emitters (n,) of one kind on an ephemeris, from `ignition_s` to `burnout_s`.

    `turns_s` (n, k) are the scene times at which courses bend.
    """

    kind: str
    type_code: ByteArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    flight: Ephemeris
    turns_s: FloatArray
    emitters_truth: tuple[Mapping[str, Any], ...]

    @property
    def class_names(self) -> Sequence[str]:
        """The kind of each emitter."""
        return [self.kind] * len(self.type_code)

    @property
    def course_breakpoints_s(self) -> FloatArray | None:
        """Scene times (n, k) at which the direction of flight bends, s."""
        return self.turns_s

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of emitters (m,) at scene times (m,); nan when they do not
        shine.
        """
        shines = time_s <= self.burnout_s[target]
        return self.flight.position_m(target, np.where(shines, time_s, np.nan))

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return the truth of each source, its kind and start, as plain values."""
        return self.emitters_truth


def moving_sources(
    kind: str,
    resembles: str,
    emitters: Emitters,
    context: SourceContext,
    flight: Ephemeris,
    end_s: FloatArray,
    signatures: Signatures,
    turns_s: FloatArray | None = None,
) -> Sources:
    """Return emitters (n,) of a kind, which resembles a type of `EMITTER_TYPES`, on an ephemeris
    until they go out (n,).
    """
    truth = truth_of(kind, emitters, context.id)
    count = len(emitters)
    trajectories = MovingTrajectories(
        kind=kind,
        type_code=np.full(count, EMITTER_TYPES.index(resembles), dtype=np.uint8),
        ignition_s=emitters["start_s"],
        burnout_s=end_s,
        flight=flight,
        turns_s=np.empty((count, 0)) if turns_s is None else turns_s,
        emitters_truth=truth,
    )
    return EmitterSources(tuple(str(row["id"]) for row in truth), trajectories, signatures)


def with_headings(emitters: Emitters, context: SourceContext) -> Emitters:
    """Return emitters with random headings where they have none."""
    heading_deg = emitters["heading_deg"]
    drawn_deg = 360.0 * uniforms(context, "heading", len(emitters))
    known_deg = np.where(np.isnan(heading_deg), drawn_deg, heading_deg)
    return Emitters({**emitters.columns, "heading_deg": known_deg})
