"""The configuration of a sensor with a narrow field that is pointed."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, Self

from attrs import Factory, asdict, evolve, field, fields_dict, frozen

from opir_core.interfaces.focal_plane import FocalPlaneConfig
from opir_core.scene.fields import METADATA_KEY, info_of, nested, number
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
        maximum=180.0,
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
    sun_keep_out_deg: float = number(
        default=0.0,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        source="0: no limit but solar_exclusion_deg, of each line of sight",
        help="least angle between the axis of the field and the Sun's centre, while any of the Sun"
        " is in view of the satellite; no look is made and no command is taken within it",
    )
    limb_keep_out_deg: float = number(
        default=0.0,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        source="0: no limit",
        help="least angle between the axis of the field and the Earth's limb, on either side of it;"
        " no look is made and no command is taken within it",
    )


def _differing(config_class: type, name: str) -> Any:
    """Return an attrs field for a setting that a mode may have in place of that of its sensor."""
    attribute = fields_dict(config_class)[name]
    info = evolve(info_of(attribute), source="as the sensor", subject="", read_if=None)
    return field(
        default=None,
        validator=attribute.validator,
        metadata={METADATA_KEY: info},
        kw_only=True,
    )


@frozen(kw_only=True)
class ModeConfig:
    """What may differ in a mode of a sensor; what a scene leaves out is as in the sensor."""

    half_angle_deg: float | None = _differing(PointingConfig, "half_angle_deg")
    slew_deg_s: float | None = _differing(PointingConfig, "slew_deg_s")
    settle_s: float | None = _differing(PointingConfig, "settle_s")
    scan_period_ms: float | None = _differing(ScanningSensorConfig, "scan_period_ms")
    line_of_sight_sigma_urad: float | None = _differing(
        ScanningSensorConfig, "line_of_sight_sigma_urad"
    )
    ifov_urad: float | None = _differing(ScanningSensorConfig, "ifov_urad")
    threshold_sigma: float | None = _differing(ScanningSensorConfig, "threshold_sigma")
    integration_time_ms: float | None = _differing(FocalPlaneConfig, "integration_time_ms")
    subframes: int | None = _differing(FocalPlaneConfig, "subframes")
    detection_probability: Mapping[str, float] | None = nested(
        default=None,
        minimum=0.0,
        maximum=1.0,
        source="as the sensor",
        help="probability of detection per look by target class, for detection: constant",
    )


@frozen
class PointedSensorConfig(ScanningSensorConfig):
    """What a scene may set of a sensor with a narrow field: it looks only where it is pointed, and
    its field of regard is where it can be.
    """

    pointing: PointingConfig = nested(
        default=PointingConfig(), help="its narrow field, and how fast that is moved"
    )
    modes: Mapping[str, ModeConfig] = nested(
        default=Factory(dict),
        source="none: the sensor's own settings alone",
        help="by name, the settings that differ while the sensor is in a mode that a command names;"
        " it starts with its own settings, and a mode without any ({}) returns to these",
    )

    @property
    def is_pointed(self) -> bool:
        """Whether commands are taken."""
        return True

    def in_mode(self, name: str) -> Self:
        """Return the settings of the sensor in a mode, itself without modes."""
        mode = self.modes[name]
        changes = {key: value for key, value in asdict(mode).items() if value is not None}
        pointing = evolve(self.pointing, **_taken(changes, fields_dict(PointingConfig)))
        plane_changes = _taken(changes, ("integration_time_ms", "subframes"))
        if self.focal_plane is not None:
            changes["focal_plane"] = evolve(self.focal_plane, **plane_changes)
        elif plane_changes:
            raise ValueError(f"{next(iter(plane_changes))}: the sensor has no focal_plane")
        if "threshold_sigma" in changes:
            changes["false_alarm_probability"] = None
        chances = {**self.detection_probability, **changes.pop("detection_probability", {})}
        return evolve(self, pointing=pointing, modes={}, detection_probability=chances, **changes)

    def _complaints(self) -> list[str | None]:
        return [*super()._complaints(), *map(self._mode_complaint, self.modes)]

    def _mode_complaint(self, name: str) -> str | None:
        try:
            self.in_mode(name)
        except ValueError as error:
            return f"modes.{name}: {error}"
        return None if name else "modes: a mode without a name"


@frozen
class SteeredSensorConfig(PointedSensorConfig):
    """What a scene may set of a sensor that looks at its whole field of regard, until a command
    names one of its modes. Without modes it takes no commands.
    """

    #: Left out of the canonical form of scenes that do not set them.
    unwritten: ClassVar[tuple[str, ...]] = ("pointing", "modes")

    pointing: PointingConfig = nested(
        default=PointingConfig(half_angle_deg=180.0, settle_s=1.0),
        source="notional; 180 deg: the whole field of regard, wherever it is pointed",
        help="its field without a mode, and how fast that is moved",
    )

    @property
    def is_pointed(self) -> bool:
        """Whether commands are taken."""
        return bool(self.modes) or self.pointing.half_angle_deg < 180.0

    def rate_complaint(self, name: str, half_angle_deg: float) -> str | None:
        """Return why the scan is too slow for a mode, of a sensor whose field of regard has a half
        angle.

        Its own settings use the scan to the full: solid angle over scan period, times the
        integration time where a scan shares its time among places (not `staring`), is no more in
        any mode.
        """
        mode = self.in_mode(name)
        field_deg = min(mode.pointing.half_angle_deg, half_angle_deg)
        angle_ratio = _solid_angle_sr(field_deg) / _solid_angle_sr(half_angle_deg)
        dwell_ratio = 1.0
        if self.scan_pattern != "staring":
            dwell_ratio = _dwell_ms(mode) / _dwell_ms(self)
        least_ms = self.scan_period_ms * angle_ratio * dwell_ratio
        if mode.scan_period_ms >= least_ms * (1.0 - 1e-9):
            return None
        dwell = f", {dwell_ratio:.3g} times as long at each place" if dwell_ratio != 1.0 else ""
        return (
            f"{field_deg:g} deg in {mode.scan_period_ms:g} ms{dwell} is faster than its own scan,"
            f" {half_angle_deg:g} deg in {self.scan_period_ms:g} ms; give scan_period_ms:"
            f" {math.ceil(least_ms * 100.0) / 100.0:g} or more, or a smaller half_angle_deg"
        )


def _solid_angle_sr(half_angle_deg: float) -> float:
    return 4.0 * math.pi * math.sin(0.5 * math.radians(half_angle_deg)) ** 2


def _dwell_ms(config: ScanningSensorConfig) -> float:
    """Return for how long a sensor collects light of a place in a scan; 1 without a focal plane."""
    plane = config.focal_plane
    return 1.0 if plane is None else min(plane.integration_time_ms, config.scan_period_ms)


def _taken(changes: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Take the changes of some names out of others."""
    return {name: changes.pop(name) for name in names if name in changes}
