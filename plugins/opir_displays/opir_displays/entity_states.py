"""Tracks as Entity State PDUs of DIS (IEEE 1278.1-2012, section 7.2.2, protocol version 7)."""

import math
import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import length, local_axes
from opir_core.plugin import Window
from opir_displays.reported_types import UNKNOWN, reported_types
from opir_displays.settings import DisConfig

#: Header; entity and force; entity type and its alternative; velocity, location and orientation;
#: appearance; algorithm of dead reckoning; character set and marking; capabilities.
_PDU = struct.Struct(">4BIH2x 3H2B 2BH4B8x 3f3d3f I B39x B11s 4x")
_VERSION = 7
#: Entity kind, domain and category (SISO-REF-010): guided munitions, strategic and tactical.
_KINDS = {"ICBM": (2, 10, 1), "IRBM": (2, 10, 1), "SRBM": (2, 11, 1), UNKNOWN: (0, 0, 0)}
#: Heartbeats after which an entity without estimates is given up (HBT_TIMEOUT_MPLIER).
_TIMEOUT_HEARTBEATS = 2.4
_HOUR_US = 3_600_000_000


class Entity(NamedTuple):
    """A track as a display knows it: ECEF position, m, and velocity, m/s, at a scene time; `seen_s`
    is the time of the track's last estimate.
    """

    track: int
    kind: str
    time_s: float
    position: FloatArray
    velocity: FloatArray
    seen_s: float

    def at(self, time_s: float) -> "Entity":
        """Return the entity at another time by dead reckoning, at constant velocity."""
        position = self.position + (time_s - self.time_s) * self.velocity
        return self._replace(time_s=time_s, position=position)


class EntityStates:
    """Tracks as PDUs, each at the time at which its estimate was available.

    A PDU is sent of a track that is new, changes its type, ends, or is off its dead reckoning, and
    as a heartbeat, also between estimates.
    """

    def __init__(self, config: DisConfig, epoch_us: int) -> None:
        self._config = config
        self._epoch_us = epoch_us
        self._clock_s = -math.inf
        #: What was sent last, by track.
        self._entities: dict[int, Entity] = {}

    def rows(self, window: Window) -> Iterator[tuple[int, Sequence[bytes]]]:
        """Yield the PDU of each of the window's tracks, if one is due, and those of heartbeats."""
        tracks = window.tracks
        velocity = tracks.state[:, 3:]
        delay_s = tracks.available_s - tracks.tick_s
        columns = zip(
            tracks.track.tolist(),
            reported_types(tracks)[0],
            tracks.available_s.tolist(),
            tracks.state[:, :3] + delay_s[:, np.newaxis] * velocity,
            velocity,
            tracks.available_s.tolist(),
            strict=True,
        )
        for entity, ends in zip(map(Entity._make, columns), tracks.end > 0, strict=True):
            yield from self._heartbeats(entity.time_s)
            yield 1, self._update(entity, ends=bool(ends))
        yield from self._heartbeats(window.end_s)

    def _heartbeats(self, until_s: float) -> Iterator[tuple[int, Sequence[bytes]]]:
        """Yield the heartbeats that are due before a time."""
        if until_s <= self._clock_s:
            return
        self._clock_s = until_s
        beat_s = self._config.heartbeat_s
        for track, sent in list(self._entities.items()):
            entity = sent
            while entity.time_s + beat_s < until_s:
                entity = entity.at(entity.time_s + beat_s)
                if entity.time_s > entity.seen_s + _TIMEOUT_HEARTBEATS * beat_s:
                    del self._entities[track]
                    break
                self._entities[track] = entity
                yield 0, [self._pdu(entity)]

    def _update(self, entity: Entity, *, ends: bool) -> list[bytes]:
        """Return the PDU of a track's estimate, if one is due."""
        sent = self._entities.get(entity.track)
        if ends:
            self._entities.pop(entity.track, None)
        if not np.isfinite([entity.time_s, *entity.position, *entity.velocity]).all():
            return []
        if not ends and sent is not None and self._is_as_sent(entity, sent):
            self._entities[entity.track] = sent._replace(seen_s=entity.time_s)
            return []
        if not ends:
            self._entities[entity.track] = entity
        return [self._pdu(entity, ends=ends)]

    def _is_as_sent(self, entity: Entity, sent: Entity) -> bool:
        """Return whether a display still knows a track well enough."""
        error_m = length(*(entity.position - sent.at(entity.time_s).position))
        return bool(
            entity.kind == sent.kind
            and entity.time_s - sent.time_s < self._config.heartbeat_s
            and error_m <= self._config.threshold_m
        )

    def _pdu(self, entity: Entity, *, ends: bool = False) -> bytes:
        config = self._config
        unix_us = round(1e6 * entity.time_s) + self._epoch_us
        # Time past the hour in 2**31 steps; the last bit is 0, for a clock of its own.
        timestamp = 2 * (unix_us % _HOUR_US * 2**31 // _HOUR_US)
        number = entity.track % 65_534 + 1
        kind, domain, category = _KINDS[entity.kind]
        return _PDU.pack(
            *(_VERSION, config.exercise, 1, 1, timestamp, _PDU.size),
            *(config.site, config.application, number, config.force, 0),
            *(kind, domain, 0, category, 0, 0, 0),
            *entity.velocity,
            *entity.position,
            *orientation(entity.position, entity.velocity),
            int(ends) << 23,  # deactivated
            2,  # fixed orientation, constant velocity, world coordinates
            1,  # ASCII
            f"T{entity.track} {entity.kind}".encode(),
        )


def orientation(position: FloatArray, velocity: FloatArray) -> tuple[float, float, float]:
    """Return the Euler angles psi, theta and phi (3,), rad, of a body at an ECEF position, m, that
    flies along its velocity, m/s, without roll: its right wing is horizontal.
    """
    x, y, z = velocity.tolist()
    psi = math.atan2(y, x)
    theta = math.atan2(-z, math.hypot(x, y))
    up = local_axes(position)[2]
    right = np.array([-math.sin(psi), math.cos(psi), 0.0])
    below = np.array(
        [math.sin(theta) * math.cos(psi), math.sin(theta) * math.sin(psi), math.cos(theta)]
    )
    return psi, theta, math.atan2(right @ up, -(below @ up))
