"""Directions in which the axis of a narrow field must not point: beside the Sun, along the limb."""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.geometry.sun import limb_angle_rad
from opir_core.interfaces.sensors import Pointing
from opir_core.planning.solar_exclusion import SolarExclusion


@frozen(eq=False)
class KeepOut:
    """The least angles of an axis to the Sun and to the Earth's limb, rad; 0 for no limit."""

    sun: SolarExclusion
    limb_rad: float

    @classmethod
    def of(cls, pointing: Pointing, epoch_us: int) -> "KeepOut | None":
        """Return the keep-out of a narrow field, None without a limit."""
        if not pointing.sun_keep_out_rad and not pointing.limb_keep_out_rad:
            return None
        always = np.array([np.inf])
        sun = SolarExclusion(pointing.sun_keep_out_rad, epoch_us, -always, always)
        return cls(sun, pointing.limb_keep_out_rad)

    def is_clear(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, time_s: FloatArray
    ) -> BoolArray:
        """Return which axes, from positions to targets (n, 3), may be looked along at scene times
        (n,).
        """
        clear = np.abs(limb_angle_rad(sensor_ecef_m, target_ecef_m)) >= self.limb_rad
        if self.sun.angle_rad:
            clear &= self.sun.is_clear(sensor_ecef_m, target_ecef_m, time_s)
        return clear

    def refusal(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, time_s: FloatArray
    ) -> str:
        """Return why the axis from a position to a target (1, 3) is refused at a time (1,), "" if
        it is not.
        """
        if near := sun_refusal(self.sun, sensor_ecef_m, target_ecef_m, time_s):
            return near
        limb_rad = abs(float(limb_angle_rad(sensor_ecef_m, target_ecef_m)[0]))
        is_near = limb_rad < self.limb_rad
        return _words(limb_rad, "the Earth's limb", self.limb_rad) if is_near else ""


def sun_refusal(
    exclusion: SolarExclusion,
    sensor_ecef_m: FloatArray,
    target_ecef_m: FloatArray,
    time_s: FloatArray,
) -> str:
    """Return how near to the Sun an excluded axis is, as `KeepOut.refusal`."""
    margin_rad = float(exclusion.margin_rad(sensor_ecef_m, target_ecef_m, time_s)[0])
    if not exclusion.angle_rad or margin_rad > 0.0:
        return ""
    return _words(exclusion.angle_rad + margin_rad, "the Sun", exclusion.angle_rad)


def _words(angle_rad: float, what: str, least_rad: float) -> str:
    angle_deg, least_deg = np.degrees([angle_rad, least_rad])
    return f"{angle_deg:.1f} deg from {what}; keep-out {least_deg:g} deg"
