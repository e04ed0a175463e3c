"""The configuration of a sensor with a narrow field that is pointed."""

from attrs import frozen

from opir_core.scene.fields import nested, number
from opir_core.sensors.scanning_sensor import ScanningSensorConfig


def place_complaint(place_deg: tuple[float, float] | None) -> str | None:
    """Return what is wrong with a place, [latitude, east longitude] in degrees; None for nothing."""
    if place_deg is None or (abs(place_deg[0]) <= 90.0 and abs(place_deg[1]) <= 180.0):
        return None
    return f"[{place_deg[0]:g}, {place_deg[1]:g}] is no [latitude, longitude]"


@frozen
class PointingConfig:
    """The narrow field of a sensor, and how fast it is moved."""

    half_angle_deg: float = number(
        default=1.0,
        unit="deg",
        above=0.0,
        maximum=90.0,
        help="half angle of the field about the direction in which the sensor is pointed",
    )
    slew_deg_s: float = number(
        default=2.0,
        unit="deg/s",
        above=0.0,
        maximum=360.0,
        help="rate of turning to another direction; no look is made meanwhile",
    )
    settle_s: float = number(
        default=2.0,
        unit="s",
        minimum=0.0,
        maximum=3600.0,
        help="time after a turn until looks are made; none after a correction within the field",
    )
    delay_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        help="time from a command to the start of the turn: uplink and planning on board",
    )
    at_deg: tuple[float, float] | None = nested(
        default=None,
        unit="deg",
        check=place_complaint,
        help="place at which the sensor is pointed without a command, [latitude, east longitude];"
        " default: nadir",
    )


@frozen
class PointedSensorConfig(ScanningSensorConfig):
    """What a scene may set of a sensor with a narrow field: it looks only where it is pointed, and
    its field of regard is where it can be.
    """

    pointing: PointingConfig = nested(
        default=PointingConfig(), help="its narrow field, and how fast that is moved"
    )
