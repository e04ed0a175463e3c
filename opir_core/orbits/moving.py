"""Orbits that move over the ground: evaluated from polynomials that are fitted once a span of scene time.

The motion of a satellite on a Kepler orbit, over the turning Earth.

The ideal geostationary slot.
"""

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np
from attrs import define, field, frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import GEOSTATIONARY_RADIUS_M
from opir_core.errors import ModelError
from opir_core.flight.ephemeris import Ephemeris
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import eci_to_ecef, eci_to_ecef_state
from opir_core.orbits.elements import Elements


@frozen
class TwoBodyMotion:
    """A Kepler orbit: gravity of a point mass alone, the Earth turning evenly below it (`EARTH_ROTATION_RAD_S`)."""

    elements: Elements

    def state_eci(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s, (n, 3) in ECI at scene times (n,)."""
        position, velocity = (np.array(vector) for vector in self.elements.perigee_state_eci())
        return propagate_kepler(position, velocity, np.asarray(time_s) - self.elements.perigee_time_s)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in ECEF at scene times (n,)."""
        return eci_to_ecef(self.state_eci(time_s)[0], time_s)

    def state_ecef(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities relative to the turning Earth, m/s, (n, 3) in ECEF."""
        return eci_to_ecef_state(*self.state_eci(time_s), time_s)


@frozen
class GeostationaryOrbit:
    """An ideal geostationary slot: no inclination, no eccentricity, no drift, hence one point in ECEF."""

    #: East longitude of the slot.
    slot_deg: float
    is_stationary: bool = field(default=True, init=False)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,): the same for all, as a read-only view of one row."""
        slot_rad = math.radians(self.slot_deg)
        position = (GEOSTATIONARY_RADIUS_M * math.cos(slot_rad), GEOSTATIONARY_RADIUS_M * math.sin(slot_rad), 0.0)
        return np.broadcast_to(np.array(position), (len(time_s), 3))


#: Length of a span, s. A power of two, so that dividing by it is exact and every time has one span.
SPAN_S = 2048.0

#: Spans kept at a time: the oldest goes first, and comes back bit by bit the same.
KEPT_SPANS = 64

#: Pieces that a span is cut into to begin with. They are enough for circular orbits above 300 km, and cost nothing
#: where one would do: fitting 16 takes as long as fitting one, and a third as long as finding that one is too few.
_PIECES = 16

#: Times at which a motion is sampled for one span, at most. Smooth ones need 150 to 1 000.
_MOST_SAMPLES = 8192

#: Times this far from the scene epoch (777 days), or further, have no position: spans have numbers of 16 bits.
FARTHEST_S = 2.0**15 * SPAN_S


class EarthFixedMotion(Protocol):
    """How a satellite moves over the ground, element by element."""

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,)."""

    def state_ecef(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities relative to the turning Earth, m/s, (n, 3) at scene times (n,)."""


@define(eq=False)
class MovingOrbit:
    """The orbit of a satellite that moves in ECEF, to `tolerance_m`.

    Spans begin at whole multiples of `SPAN_S` of scene time, whatever times are asked for: a position depends on its
    own time alone. In a span that no polynomials follow to the tolerance (SGP4 jumps where its theory changes, and
    ends where a satellite decays) the motion itself is asked, time by time.
    """

    motion: EarthFixedMotion
    tolerance_m: float = 1e-3
    is_stationary: bool = field(default=False, init=False)
    _spans: dict[int, Ephemeris | None] = field(factory=dict, init=False, repr=False)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,); nan at times that are not finite, or `FARTHEST_S` from 0."""
        time = np.asarray(time_s, dtype=np.float64)
        span = np.floor(time / SPAN_S)
        if len(span) and abs(time[0]) < FARTHEST_S and (span == span[0]).all():
            return self._position_m(int(span[0]), time)
        position = np.full((len(time), 3), np.nan)
        for number, rows in _rows_by_number(span, np.flatnonzero(np.abs(time) < FARTHEST_S)):
            position[rows] = self._position_m(number, time[rows])
        return position

    def _position_m(self, number: int, time_s: FloatArray) -> FloatArray:
        """Return positions at times that are all in one span."""
        if number not in self._spans:
            if len(self._spans) >= KEPT_SPANS:
                del self._spans[next(iter(self._spans))]
            self._spans[number] = self._fitted(number)
        ephemeris = self._spans[number]
        return self.motion.position_ecef_m(time_s) if ephemeris is None else ephemeris.position_m(0, time_s)

    def _fitted(self, number: int) -> Ephemeris | None:
        """Return the polynomials of a span, or None where there are none to the tolerance."""
        start_s = number * SPAN_S
        cuts_s = start_s + np.arange(1, _PIECES)[None, :] * (SPAN_S / _PIECES)
        samples = 0

        def state(_target: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
            nonlocal samples
            samples += len(time_s)
            if samples > _MOST_SAMPLES:
                raise ModelError("the motion is too rough")
            return self.motion.state_ecef(time_s)

        try:
            return Ephemeris.build(state, start_s, start_s + SPAN_S, cuts_s, self.tolerance_m)
        except ModelError:
            return None


def _rows_by_number(numbers: FloatArray, rows: RowArray) -> Iterator[tuple[int, RowArray]]:
    """Yield each number that stands in some of the rows, with those of them in which it stands, in order."""
    part = numbers[rows].astype(np.int16)
    order = np.argsort(part, kind="stable")
    edges = np.flatnonzero(np.diff(part[order])) + 1
    for group in np.split(rows[order], edges) if len(rows) else ():
        yield int(numbers[group[0]]), group
