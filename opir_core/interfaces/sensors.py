"""Sensors, and what they consist of: bands, radiometer, orbit, scan, reporting stages."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.focal_plane import FocalPlaneConfig
from opir_core.notebook import html_view

#: Spans of time, s: start and end of each, in order.
Spans = tuple[tuple[float, float], ...]


def spans_without(spans: Spans, from_s: float, until_s: float) -> Spans:
    """Return spans without what lies between two times."""
    pieces = [
        piece
        for start_s, end_s in spans
        for piece in ((start_s, min(end_s, from_s)), (max(start_s, until_s), end_s))
    ]
    return tuple((start_s, end_s) for start_s, end_s in pieces if start_s < end_s)


@frozen
class Band:
    """A spectral band, in µm."""

    name: str
    lower_um: float
    upper_um: float


@frozen
class Radiometer:
    """Radiometric properties of a sensor, by band in the order of its `bands`.

    `nei_w_m2` are noise-equivalent irradiances per look, nan where they follow from the focal
    plane; `ifov_rad` is the angle across a resolution cell; `collection_m2_s` the product of
    aperture area, efficiency and integration time, which gives photons from irradiance. A look
    detects above `threshold` standard deviations of its noise. For rules over several bands it is
    that of the band `reference`, and `coincidence` that of the others; `ratios` bound their
    intensity over that of the reference band at the source, and `ratio_tolerance` is how far noise
    may carry a measurement beyond these bounds, in standard deviations. `confirmation` are the
    detections M that a sensor needs in N successive scans to report the last, within the distance
    that a source moves at `confirmation_speed_m_s`.

    With `focal_planes`, by band, noise, clutter, saturation and the accuracy of lines of sight
    follow from them, in pixels of `ifov_rad`.
    """

    nei_w_m2: tuple[float, ...]
    ifov_rad: float
    collection_m2_s: float
    threshold: float
    coincidence: float
    ratios: tuple[tuple[float, float], ...]
    focal_planes: tuple[FocalPlaneConfig, ...] = ()
    ratio_tolerance: float = 0.0
    reference: int = 0
    confirmation: tuple[int, int] = (1, 1)
    confirmation_speed_m_s: float = 0.0


class Orbit(Protocol):
    """The orbit of a satellite.

    >>> class Parked:
    ...     is_stationary = True
    ...
    ...     def position_ecef_m(self, time_s):
    ...         return np.tile([4.2164e7, 0.0, 0.0], (len(time_s), 1))
    >>> orbit: Orbit = Parked()
    >>> orbit.position_ecef_m(np.zeros(2)).shape
    (2, 3)
    """

    @property
    def is_stationary(self) -> bool:
        """Whether the position in ECEF does not change."""

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,)."""


class ScanPattern(Protocol):
    """The scan of a sensor: times of looks within its period.

    >>> class Together:
    ...     period_ns = 5_000_000_000
    ...
    ...     def phase_ns(self, sensor_ecef_m, target_ecef_m, uniform):
    ...         return np.full(len(target_ecef_m), int(uniform * self.period_ns))
    >>> scan: ScanPattern = Together()
    >>> scan.phase_ns(np.zeros(3), np.zeros((2, 3)), 0.5)
    array([2500000000, 2500000000])
    """

    @property
    def period_ns(self) -> int:
        """Time between two looks at one target, ns: a positive integer, so that look times are
        exact.
        """

    def phase_ns(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float
    ) -> IntArray:
        """Return offsets (n,) in [0, period) of the looks at targets (n, 3); scan k looks at phase
        + k · period.

        `uniform` is a random number of the sensor in [0, 1), for patterns with a random start.
        """


@frozen
class ReportingStage:
    """A stage between a look and its report: the mean and the standard deviation of its latency, s.

    The latency is constant where `sigma_s` is 0, else gamma distributed.
    """

    name: str
    mean_s: float
    sigma_s: float = 0.0


class Pointing(NamedTuple):
    """The narrow field of a sensor that is pointed: it looks in no other direction.

    `delay_s` after a command it turns at `slew_rad_s`, and looks again after `settle_s` if the new
    direction was outside of the field, or the mode another. Without a command it is pointed at
    `at_ecef_m` (3,), None for nadir. It makes no look while its axis is within `sun_keep_out_rad`
    of the Sun's centre or `limb_keep_out_rad` of the Earth's limb, 0 for no limit.
    """

    half_angle_rad: float
    slew_rad_s: float
    settle_s: float = 0.0
    delay_s: float = 0.0
    at_ecef_m: tuple[float, float, float] | None = None
    sun_keep_out_rad: float = 0.0
    limb_keep_out_rad: float = 0.0


@frozen(eq=False, kw_only=True)
class Sensor:
    """A sensor, built by a sensor model from a scene's block.

    `detection_probability` is P_d per look, by target type, for models with constant P_d;
    `confusion` gives, by true type, the probabilities of each reported type, or is empty.
    `minimum_elevation_rad` is the least elevation of the sensor above the target's horizon, -pi/2
    for no limit. `settings` are the complete settings of the sensor's block, for `opir explain` and
    the manifest.

    A sensor cannot look within `solar_exclusion_rad` of the Sun's centre while any part of the Sun
    is in view of the satellite; 0 for no limit.

    `line_of_sight_sigma_rad` is the standard deviation of single lines of sight, per axis,
    `line_of_sight_bias_sigma_rad` that of the bias, per axis, which is constant during a run. A
    sensor that `follows_bodies` observes targets after burnout, up to impact. The report of a scan
    follows its looks by the sum of the latencies of `reporting`; without stages, at once.

    `watched_s` are the spans of scene time in which it looks, in order; None for all of it. That
    nothing was detected outside of them says nothing, nor in `partial_s`, the spans in which it
    looks at a part of its field of regard alone, or its reports do not arrive. A sensor with
    `pointing` looks only where it is pointed, which its field of regard bounds; `modes` are, by
    name, what it is in each of its modes.
    """

    id: str
    type: str
    orbital_slot_deg: float | None
    bands: tuple[Band, ...]
    orbit: Orbit
    scan: ScanPattern
    field_of_regard_half_angle_rad: float
    minimum_elevation_rad: float
    line_of_sight_sigma_rad: float
    detection_probability: Mapping[str, float]
    confusion: Mapping[str, Mapping[str, float]] = field(factory=dict)
    line_of_sight_bias_sigma_rad: float = 0.0
    false_alarm_susceptibility: str = "moderate"
    spectral_discrimination: str = "none"
    follows_bodies: bool = False
    solar_exclusion_rad: float = 0.0
    radiometer: Radiometer | None = None
    reporting: tuple[ReportingStage, ...] = ()
    watched_s: Spans | None = None
    partial_s: Spans = ()
    pointing: Pointing | None = None
    modes: "Mapping[str, Sensor]" = field(factory=dict)
    settings: Mapping[str, Any] = field(factory=dict)

    def __repr__(self) -> str:
        """Return id, type and bands, in one line."""
        bands = ", ".join(band.name for band in self.bands)
        return f"<Sensor {self.id}: {self.type}, {bands}>"

    def _repr_html_(self) -> str:
        """Return the settings for a notebook."""
        return html_view(
            self, ("setting", "value"), list(self.settings.items()), len(self.settings)
        )

    @property
    def is_narrow(self) -> bool:
        """Whether its field does not hold its whole field of regard wherever it is pointed."""
        if self.pointing is None:
            return False
        whole_rad = min(2.0 * self.field_of_regard_half_angle_rad, np.pi)
        return self.pointing.half_angle_rad < whole_rad

    def stated(self, end_s: float) -> "Sensor":
        """Return the sensor with the spans in which it looks at its whole field of regard, of a
        scene that ends at a time.
        """
        if not self.partial_s:
            return self
        spans = self.spans_until_s(end_s)
        for from_s, until_s in self.partial_s:
            spans = spans_without(spans, from_s, until_s)
        return evolve(self, watched_s=spans, partial_s=())

    def spans_until_s(self, end_s: float) -> Spans:
        """Return the spans in which it looks of a scene that ends at a time."""
        return ((0.0, end_s),) if self.watched_s is None else self.watched_s

    def watched_until_s(self, time_s: FloatArray) -> FloatArray:
        """Return for how long (n,), s, it has looked from the scene's start to times (n,)."""
        if self.watched_s is None:
            return time_s
        if not self.watched_s:
            return np.zeros(len(time_s))
        edges_s = np.ravel(self.watched_s)
        lengths_s = np.diff(edges_s)
        lengths_s[1::2] = 0.0
        return np.interp(time_s, edges_s, np.append(0.0, np.cumsum(lengths_s)))

    def is_watching(self, time_s: FloatArray) -> BoolArray:
        """Return whether it looks at times (n,)."""
        watching = np.full(len(time_s), self.watched_s is None)
        for start_s, end_s in self.watched_s or ():
            watching |= (time_s >= start_s) & (time_s <= end_s)
        return watching
