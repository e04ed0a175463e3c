"""The configuration of a sensor with a narrow field that is pointed."""

from attrs import frozen

from opir_core.scene.fields import nested, number
from opir_core.sensors.scanning_sensor import ScanningSensorConfig


@frozen(kw_only=True)
class PlaceConfig:
    """A place on the ellipsoid."""

    lat_deg: float = number(
        help="geodetic latitude", unit="deg", minimum=-90.0, maximum=90.0, source=""
    )
    lon_deg: float = number(
        help="east longitude", unit="deg", minimum=-180.0, maximum=180.0, source=""
    )


@frozen(kw_only=True)
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
    at: PlaceConfig | None = nested(
        default=None,
        help="place at which the sensor is pointed without a command; default: nadir",
    )


@frozen(kw_only=True)
class PointedSensorConfig(ScanningSensorConfig):
    """What a scene may set of a sensor with a narrow field: it looks only where it is pointed, and
    its field of regard is where it can be.
    """

    pointing: PointingConfig = nested(
        default=PointingConfig(), help="its narrow field, and how fast that is moved"
    )
