"""Faults of sensors during a scene: what fails, from when until when."""

import math
from typing import Any

from attrs import frozen

from opir_core.scene.fields import number, text

DOWN, BLIND, NOISE, BIAS, CLOCK, STUCK = FAULTS = (
    "down",
    "blind",
    "noise",
    "bias",
    "clock",
    "stuck-scan",
)

#: The settings that each fault reads, of which at least one is to be set.
_SETTINGS = {
    DOWN: (),
    BLIND: (),
    NOISE: ("factor",),
    BIAS: ("east_urad", "north_urad"),
    CLOCK: ("offset_s",),
    STUCK: (),
}


def require_span(failure: Any) -> None:
    """Raise a `ValueError` if the times of a failure are wrong: `at_s`, `until_s`, `mtbf_s` and
    `mttr_s`.
    """
    if failure.until_s is not None and not failure.at_s < failure.until_s:
        raise ValueError(f"the repair at {failure.until_s:g} s is not after {failure.at_s:g} s")
    if (failure.mtbf_s is None) != (failure.mttr_s is None):
        raise ValueError("mtbf_s and mttr_s belong together")


@frozen
class SensorFault:
    """A fault of one sensor, from `at_s` until `until_s`; repaired then. With `mtbf_s` and `mttr_s`
    it comes and goes at random in this time.

    >>> SensorFault(sensor="S2", fault="noise", at_s=60.0, factor=3.0).end_s
    inf
    """

    sensor: str = text(help="id of the sensor", source="")
    fault: str = text(
        help="down: it does not look, and a tracker knows; blind: it looks and sees nothing, and"
        " nothing reports it; noise: its lines of sight scatter by a factor more than it states; bias:"
        " it points beside where it states; clock: its times are late or early; stuck-scan: it sees"
        " only where its scan was, or its field was pointed",
        choices=FAULTS,
        source="",
    )
    at_s: float = number(help="start of the fault, scene time", unit="s", minimum=0.0, source="")
    until_s: float | None = number(
        help="time of the repair; without one the fault stays",
        unit="s",
        above=0.0,
        default=None,
        source="choice",
    )
    mtbf_s: float | None = number(
        help="mean time between failures: between `at_s` and `until_s` the fault comes at random, by"
        " the seed",
        unit="s",
        minimum=1.0,
        default=None,
        source="choice",
    )
    mttr_s: float | None = number(
        help="mean time to repair of faults at random",
        unit="s",
        above=0.0,
        default=None,
        source="choice",
    )
    factor: float | None = number(
        help="of noise: true over stated standard deviation",
        above=0.0,
        maximum=1e4,
        default=None,
        source="choice",
    )
    east_urad: float | None = number(
        help="of bias: by how much a line of sight to nadir moves towards east",
        unit="urad",
        default=None,
        source="choice",
    )
    north_urad: float | None = number(
        help="of bias: the same towards north", unit="urad", default=None, source="choice"
    )
    offset_s: float | None = number(
        help="of clock: its time minus the true time",
        unit="s",
        minimum=-60.0,
        maximum=60.0,
        default=None,
        source="choice",
    )

    def __attrs_post_init__(self) -> None:
        own = _SETTINGS[self.fault]
        values = {name: getattr(self, name) for name in set().union(*_SETTINGS.values())}
        given = {name for name, value in values.items() if value is not None}
        unread = sorted(given.difference(own))
        if unread:
            raise ValueError(f"{self.fault} has no {unread[0]}")
        if own and not given:
            raise ValueError(f"{self.fault} needs {' or '.join(own)}")
        require_span(self)

    @property
    def end_s(self) -> float:
        """The time of the repair, s; inf without one."""
        return math.inf if self.until_s is None else self.until_s

    def __str__(self) -> str:
        """Return the fault in words: `S2: noise (factor 3) from 60 s on`."""
        values = {name: getattr(self, name) for name in _SETTINGS[self.fault]}
        given = [f"{name} {value:g}" for name, value in values.items() if value is not None]
        size = f" ({', '.join(given)})" if given else ""
        end = "on" if self.until_s is None else f"to {self.until_s:g} s"
        rate = (
            "" if self.mtbf_s is None else f" at random, {self.mttr_s:g} s every {self.mtbf_s:g} s"
        )
        return f"{self.sensor}: {self.fault}{size} from {self.at_s:g} s {end}{rate}"
