"""The configuration of a scanning sensor, which constellation plugins inherit. Nothing heavy is
imported here.
"""

from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.orbits.configs import OrbitConfig
from opir_core.scene.fields import (
    BANDS,
    CONFUSION,
    DESCRIPTION,
    DETECTION_PROBABILITY,
    LIGHT,
    flag,
    nested,
    number,
    text,
)
from opir_core.scene.scene import MAXIMUM_BANDS
from opir_core.scene.target_classes import TargetClass
from opir_core.sensors.confusion_matrix import confusion_complaint, is_probability
from opir_core.sensors.radiometer import (
    RadiometerConfig,
    confirmation_complaint,
    focal_plane_complaint,
    unknown_band_complaint,
)
from opir_core.sensors.reporting import PRESETS, ReportingConfig

SCAN_PATTERNS = ("spin", "step-stare", "staring")
SCAN_PHASES = ("aligned", "random", "swept")
SUSCEPTIBILITIES = ("high", "moderate", "low")
#: How many bands each kind of spectral discrimination compares.
DISCRIMINATION_BANDS = {"likelihood": 1, "none": 1, "dual-band-ratio": 2, "triple-coincidence": 3}
#: Each of them in the description of a sensor.
DISCRIMINATION_WORDS = {
    "likelihood": "weighed by likelihood",
    "none": "any band detects",
    "dual-band-ratio": "dual-band ratio test",
    "triple-coincidence": "triple-coincidence test",
}


def _bands_complaint(bands: Any) -> str | None:
    if not isinstance(bands, Mapping) or not 1 <= len(bands) <= MAXIMUM_BANDS:
        return (
            f"{bands!r} is not a mapping of 1 to {MAXIMUM_BANDS} band names to [lower_um, upper_um]"
        )
    for name, edges in bands.items():
        if not _is_interval(edges):
            return f"{name}: {edges!r} is not [lower_um, upper_um] with 0 < lower_um < upper_um"
    return None


def _is_interval(edges: object) -> bool:
    if not isinstance(edges, tuple | list) or len(edges) != 2:
        return False
    lower, upper = edges
    return isinstance(lower, int | float) and isinstance(upper, int | float) and 0.0 < lower < upper


def _probabilities_complaint(probabilities: Any) -> str | None:
    if not isinstance(probabilities, Mapping):
        return f"{probabilities!r} is not a mapping of target types to probabilities"
    for name, probability in probabilities.items():
        if not is_probability(probability):
            return f"{name}: {probability!r} is not a probability in [0, 1]"
    return None


_SWEPT = ("unless scan_phase: aligned", lambda config: config.scan_phase != "aligned")
_RASTER = (
    "with scan_pattern: step-stare or staring, unless scan_phase: aligned",
    lambda config: config.scan_pattern != "spin" and config.scan_phase != "aligned",
)


@frozen
class ScanningSensorConfig(RadiometerConfig):
    """What a scene may set of a scanning sensor: in a geostationary slot, or in any orbit.

    A sensor model inherits this class, gives its own defaults with `with_defaults`, and needs at
    least those of `bands`, `scan_period_ms` and `detection_probability`. A mapping of detection
    probabilities or a confusion matrix that names some target classes leaves the model's defaults
    for the others.
    """

    orbital_slot_deg: float | None = number(
        default=None,
        unit="deg",
        minimum=-180.0,
        maximum=180.0,
        source="no default: a scene places its sensors",
        help="east longitude of an ideal geostationary slot; this or orbit",
    )
    orbit: OrbitConfig | None = nested(
        default=None,
        source="no default: a scene places its sensors",
        help="any other orbit; this or orbital_slot_deg",
    )
    bands: Mapping[str, tuple[float, float]] = nested(
        unit="um",
        check=_bands_complaint,
        help="spectral bands by name, each [lower_um, upper_um]",
        subject=BANDS,
    )
    scan_period_ms: float = number(
        unit="ms",
        above=0.0,
        maximum=86_400_000.0,
        help="time between two looks at one target, in whole nanoseconds",
    )
    scan_pattern: str = text(
        default="staring",
        choices=SCAN_PATTERNS,
        help="how the field of regard is covered",
        read_if=_SWEPT,
    )
    scan_phase: str = text(
        default="random",
        choices=SCAN_PHASES,
        source="random: a launch does not wait for a scan. aligned: the convention behind the"
        " latencies of the"
        " opir-simulator paper (2026), section 5.1",
        help="when in the period a look falls: where the pattern reaches the target's place at"
        " ignition, from a start"
        " drawn once a sensor and run (random; swept is an older word for it); at whole periods of"
        " scene time, so that"
        " a launch on a scan instant is first seen a full period after ignition (aligned)",
    )
    raster_rows: int = number(
        default=8,
        minimum=1,
        maximum=100,
        help="rows of stares, or of arrays that stare side by side",
        read_if=_RASTER,
    )
    raster_columns: int = number(
        default=8,
        minimum=1,
        maximum=100,
        help="columns of stares, or of arrays that stare side by side",
        read_if=_RASTER,
    )
    detection_probability: Mapping[str, float] = nested(
        minimum=0.0,
        maximum=1.0,
        check=_probabilities_complaint,
        names_of=TargetClass.hook,
        help="probability of detection per look by target class, for detection: constant; a class"
        " without one has that"
        " of the type it resembles",
        subject=DETECTION_PROBABILITY,
    )
    field_of_regard_half_angle_deg: float | None = number(
        default=None,
        unit="deg",
        above=0.0,
        maximum=180.0,
        plausible=(0.01, 180.0),
        source="the Earth's disk from the least height of half a day, from a geostationary slot"
        " asin(6378.137 / 42164.17) = 8.70 deg, and a notional margin of 1.3 deg for targets beyond"
        " the limb",
        help="half angle, from nadir, of the cone that the sensor covers; none: the Earth and its"
        " limb from the"
        " orbit, 10 deg in a geosynchronous slot",
    )
    minimum_elevation_deg: float = number(
        default=-90.0,
        unit="deg",
        minimum=-90.0,
        maximum=90.0,
        source="-90: all that the Earth does not hide",
        help="least elevation of the sensor above the target's horizon",
    )
    solar_exclusion_deg: float = number(
        default=5.0,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        source="notional: within the 2.5 to 7.3 deg from the Earth's limb at which the Sun strays"
        " into civil"
        " geostationary imagers, 45 min from midnight and 45 days from equinox (NOAA, GOES-R stray"
        " light, 2018)",
        help="least angle between a line of sight and the Sun's centre, while any of the Sun is in"
        " view of the"
        " satellite; 0 for no limit",
    )
    line_of_sight_sigma_urad: float = number(
        default=20.0,
        unit="urad",
        minimum=0.0,
        maximum=1e5,
        help="standard deviation of a measured direction, per axis",
    )
    line_of_sight_bias_sigma_urad: float = number(
        default=0.0,
        unit="urad",
        minimum=0.0,
        maximum=1e5,
        source="0: no bias, as in the opir-simulator paper (2026)",
        help="standard deviation, per axis, of the constant error of all a sensor's directions,"
        " drawn once a run",
    )
    reporting: ReportingConfig = nested(
        default=ReportingConfig(),
        source="none: event time, as in the opir-simulator paper (2026)",
        help="latency between a look and its report, by stage",
        named_values=PRESETS,
    )
    false_alarm_susceptibility: str = text(
        default="moderate",
        choices=SUSCEPTIBILITIES,
        help="how readily clutter is taken for a target: a description, which no model reads",
        subject=DESCRIPTION,
    )
    spectral_discrimination: str = text(
        default="none",
        choices=tuple(DISCRIMINATION_BANDS),
        help="which bands detect: the sum of all, weighed by likelihood; any (none); or all, in"
        " plausible ratios",
        subject=LIGHT,
    )
    follows_bodies: bool = flag(
        default=False,
        source="false: the opir-simulator paper (2026) watches plumes",
        help="whether the sensor goes on looking after burnout, at the warm body, to impact, as it"
        " does at gliders where the detection model reads light; with detection: constant it then"
        " sees it as well as the plume",
    )
    confusion: Mapping[str, Mapping[str, float]] = nested(
        default=Factory(dict),
        check=confusion_complaint,
        names_of=TargetClass.hook,
        inner_names=("UNKNOWN",),
        help="by true target class the probabilities of each reported type, UNKNOWN among them, for"
        " classification: paper; a class without a row has that of the type it resembles",
        subject=CONFUSION,
    )

    def __attrs_post_init__(self) -> None:
        complaints = [complaint for complaint in self._complaints() if complaint]
        if complaints:
            raise ValueError("; ".join(complaints))

    @property
    def scan_period_ns(self) -> int:
        """Return the scan period in nanoseconds, exactly."""
        return round(self.scan_period_ms * 1e6)

    def _complaints(self) -> list[str | None]:
        return [
            self._place_complaint(),
            self._period_complaint(),
            self._raster_complaint(),
            self._discrimination_complaint(),
            unknown_band_complaint(self, list(self.bands)),
            focal_plane_complaint(self, list(self.bands)),
            confirmation_complaint(self),
        ]

    def _period_complaint(self) -> str | None:
        # The double nearest to a whole number of ns, and no other, is that number over 1e6.
        if self.scan_period_ns >= 1 and self.scan_period_ns / 1e6 == self.scan_period_ms:
            return None
        nearest_ms = max(self.scan_period_ns, 1) / 1e6
        return (
            f"scan_period_ms: {self.scan_period_ms!r} is not a whole number of nanoseconds; write"
            f" {nearest_ms!r}"
        )

    def _place_complaint(self) -> str | None:
        if (self.orbital_slot_deg is None) != (self.orbit is None):
            return None
        return "a sensor has either orbital_slot_deg or orbit; give one of them"

    def _raster_complaint(self) -> str | None:
        sides: tuple[Any, ...] = (self.raster_rows, self.raster_columns)
        if all(isinstance(side, int) for side in sides):
            return None
        return (
            f"raster_rows and raster_columns: {sides[0]!r} and {sides[1]!r} are not whole numbers"
        )

    def _discrimination_complaint(self) -> str | None:
        needed = DISCRIMINATION_BANDS[self.spectral_discrimination]
        if len(self.bands) >= needed:
            return None
        return (
            f"spectral_discrimination: {self.spectral_discrimination} compares {needed} bands and"
            f" the sensor has"
            f" {len(self.bands)} ({', '.join(self.bands)})"
        )
