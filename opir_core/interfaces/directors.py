"""The contract of directors: what has arrived by a decision, and the commands to sensors."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from attrs import converters, field, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray
from opir_core.geometry.vectors import floats
from opir_core.interfaces.contract import PluginPart, optional, required
from opir_core.interfaces.records import CommandRecord, Detections, Tracks
from opir_core.interfaces.sensors import Sensor


@frozen(eq=False, kw_only=True)
class Command:
    """Points the narrow field of a sensor, given by its id, at a point that moves evenly, or has it
    look in a `mode`, one of the names in `Sensor.modes`, or both.

    `position_ecef_m` (3,) is at the time of the decision, `velocity_m_s` (3,) in ECEF; without a
    position it looks where it did, without a mode as it did. `track` is the number of the track
    that the command follows, -1 for none; `reason` is one line for people.
    """

    sensor: str
    position_ecef_m: FloatArray | None = field(default=None, converter=converters.optional(floats))
    velocity_m_s: FloatArray = field(default=(0.0, 0.0, 0.0), converter=floats)
    track: int = -1
    reason: str = ""
    mode: str = ""


def _point(values: ArrayLike) -> FloatArray:
    """Return a point (3,); `ValueError` for another shape."""
    return floats(values).reshape(3)


@frozen(eq=False, kw_only=True)
class SensorTask:
    """What an operator has a sensor do, given by its id, in place of the director's commands.

    It looks at a point (3,), ECEF, or follows a track, or looks in a `mode`; with none of these it
    is the director's again.
    """

    sensor: str
    position_ecef_m: FloatArray | None = field(default=None, converter=converters.optional(_point))
    track: int = -1
    mode: str = ""


@frozen(eq=False, kw_only=True)
class Situation:
    """What is known at the time of a decision, of what has arrived by then.

    `detections` are those reported since the last decision, `tracks` the rows of the last tick that
    is available. `sensors` are those that can be pointed. `refused` are the commands of the last
    decision that sensors did not take, and one for each sensor that an operator has given back: it
    looks elsewhere, in another mode. `in_reach(sensor, position_ecef_m, after_s)` returns which
    positions (n, 3) a sensor, given by its id, can be pointed at `after_s` after the decision, by
    default at once: in its field of regard, not behind the Earth, not beside the Sun or the limb;
    none while it does not look, its scan is stuck or its reports do not arrive. That it is blind,
    nobody knows.
    """

    time_s: float
    detections: Detections
    tracks: Tracks
    sensors: tuple[Sensor, ...]
    refused: tuple[CommandRecord, ...]
    in_reach: Callable[..., BoolArray]


@frozen(kw_only=True)
class DirectorContext:
    """The context of a director: all sensors of the scene, its zero of time and its length."""

    sensors: tuple[Sensor, ...]
    epoch_us: int
    duration_s: float


class Director(PluginPart):
    """Decides where sensors with a narrow field look, while a run goes on.

    It is asked at the start of a scene and then every `interval_s`, never at window edges, and
    knows nothing but what has arrived: no truth.

    >>> class Northward(Director):
    ...     interval_s = 60.0
    ...
    ...     def commands(self, situation):
    ...         return [
    ...             Command(sensor=sensor.id, position_ecef_m=[0.0, 0.0, 6.4e6], reason="north")
    ...             for sensor in situation.sensors
    ...         ]
    >>> Northward().interval_s
    60.0
    """

    @required
    def interval_s(self) -> float:
        """Time between decisions, s; required."""

    @optional
    def needs_detections(self) -> bool:
        """Whether `commands` reads `situation.detections`; else they are empty, which saves time."""
        return True

    @abstractmethod
    def commands(self, situation: Situation) -> Sequence[Command]:
        """Return the commands of a decision; a sensor without one goes on as it was.

        Of several commands to a sensor the last one counts.
        """


def command_fault(commands: Any) -> str:
    """Return what is wrong with the return value of `Director.commands`, or ""."""
    if not isinstance(commands, Sequence) or isinstance(commands, str):
        return f"returned {type(commands).__name__}, not a sequence of Command"
    for command in commands:
        if not isinstance(command, Command):
            return f"returned {type(command).__name__} among its commands, not a Command"
        vectors = command.position_ecef_m, command.velocity_m_s
        if any(vector is not None and vector.shape != (3,) for vector in vectors):
            return f"returned a command to {command.sensor} whose vectors are not of shape (3,)"
    return ""
