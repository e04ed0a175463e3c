"""The radiometric part of a scanning sensor's configuration."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from attrs import Factory, fields, frozen

from opir_core.interfaces.focal_plane import FocalPlaneConfig
from opir_core.scene.fields import nested, number, text

#: Bounds come in twos.
_PAIR = 2


def _ratios_complaint(ratios: Any) -> str | None:
    for name, bounds in ratios.items():
        if len(bounds) != _PAIR or bounds[0] >= bounds[1]:
            return f"{name}: {bounds!r} is not [least, most] with least < most"
    return None


@frozen(kw_only=True)
class RadiometerConfig:
    """What a scene may set of how a sensor measures light, for models that reckon with it (detection: snr)."""

    nei_w_m2: float = number(
        default=1e-12,
        unit="W/m²",
        minimum=0.0,
        maximum=1e6,
        help="noise-equivalent irradiance of a look, in each band, for detection: snr",
    )
    nei_w_cm2: float | None = number(
        default=None,
        unit="W/cm²",
        minimum=0.0,
        maximum=1e2,
        source="no default: nei_w_m2",
        help="the same in W/cm²; a scene sets one of the two",
        instead_of="nei_w_m2",
    )
    band_nei_w_m2: Mapping[str, float] = nested(
        default=Factory(dict),
        unit="W/m²",
        minimum=0.0,
        maximum=1e6,
        source="no default: nei_w_m2",
        help="by band the noise-equivalent irradiance of bands that have their own",
    )
    ifov_urad: float = number(
        default=28.0, unit="urad", above=0.0, maximum=1e5, help="angle across a resolution cell: 1 km at nadir"
    )
    collection_m2_s: float = number(
        default=0.007,
        unit="m² s",
        above=0.0,
        maximum=1e6,
        help="aperture times efficiency times integration time: with it background light has photon noise",
    )
    threshold_sigma: float = number(
        default=5.0,
        minimum=0.0,
        maximum=1e3,
        source="opir-simulator paper (2026), section 2.4",
        help="signal over noise above which a look detects",
    )
    false_alarm_probability: float | None = number(
        default=None,
        above=0.0,
        below=1.0,
        plausible=(1e-15, 0.1),
        source="no default: threshold_sigma",
        help="chance that noise alone crosses the threshold, in a resolution cell and look; a scene sets this or the"
        " threshold",
        instead_of="threshold_sigma",
    )
    coincidence_sigma: float = number(
        default=3.0,
        minimum=0.0,
        maximum=1e3,
        help="signal over noise that the other bands need where bands are compared",
    )
    reference_band: str = text(
        default="",
        source="no default: the shortest band",
        help="the band that has to cross the threshold where bands are compared, and to which the plausible ratios"
        " refer",
    )
    plausible_ratios: Mapping[str, tuple[float, float]] = nested(
        default=Factory(dict),
        minimum=0.0,
        check=_ratios_complaint,
        help="by band [least, most] intensity over that of the reference band at the source, where bands are compared;"
        " the sensor widens these bounds by what the air does to the ratio at any height of the source",
    )
    ratio_tolerance_sigma: float = number(
        default=3.0,
        minimum=0.0,
        maximum=1e3,
        source="a plume on a bound is refused with probability Q(3) = 0.0013",
        help="how far noise may carry a measurement beyond the plausible ratios, in standard deviations",
    )
    confirmation_detections: int = number(
        default=2,
        minimum=1,
        maximum=8,
        help="detections that the sensor needs before it reports the last of them, for detection: snr; 1 reports all",
    )
    confirmation_scans: int = number(
        default=3,
        minimum=1,
        maximum=64,
        help="successive scans among which these detections must be, the last one included",
    )
    confirmation_speed_m_s: float = number(
        default=8000.0,
        unit="m/s",
        minimum=0.0,
        maximum=1e5,
        source="above the circular speed at a height of 200 km, 7784 m/s",
        help="speed that a source may have for detections of several scans to be taken for one source",
    )
    focal_plane: FocalPlaneConfig | None = nested(
        default=None,
        named_values={"notional": FocalPlaneConfig()},
        source="no default: nei_w_m2 and collection_m2_s as they are",
        help="optics, detectors, filters and jitter, from which NEI, clutter, saturation and the accuracy of lines of"
        " sight follow; notional: the sensor model's own made-up values",
    )


#: Thresholds, standard deviations, at which a CFAR loss is worked out: a P_fa of 0.16 to 8e-24.
_CFAR_THRESHOLDS = (1.0, 10.0)


def focal_plane_complaint(config: RadiometerConfig, scan_period_ms: float) -> str | None:
    """Return the error in a focal plane beside the sensor's other settings, or None."""
    plane = config.focal_plane
    if plane is None:
        return None
    if plane.integration_time_ms > scan_period_ms:
        return (
            f"focal_plane.integration_time_ms: {plane.integration_time_ms:g} is longer than scan_period_ms,"
            f" {scan_period_ms:g}"
        )
    if plane.temporal_filter == "difference" and plane.lag_s * 1e3 < scan_period_ms:
        return f"focal_plane.lag_s: {plane.lag_s:g} is shorter than a scan period, {scan_period_ms * 1e-3:g} s"
    if plane.reference_cells is not None and not _is_cfar_threshold(config):
        low, high = _CFAR_THRESHOLDS
        return (
            f"focal_plane.reference_cells: the loss of a threshold above {high:g} or below {low:g} standard deviations"
            " is not worked out; change threshold_sigma or false_alarm_probability"
        )
    return None


def _is_cfar_threshold(config: RadiometerConfig) -> bool:
    """Return whether the threshold is one at which a CFAR loss is worked out."""
    chances = [0.5 * math.erfc(sigma / math.sqrt(2.0)) for sigma in _CFAR_THRESHOLDS]
    if config.false_alarm_probability is not None:
        return chances[1] <= config.false_alarm_probability <= chances[0]
    return _CFAR_THRESHOLDS[0] <= config.threshold_sigma <= _CFAR_THRESHOLDS[1]


def confirmation_complaint(config: RadiometerConfig) -> str | None:
    """Return the error in the settings of the confirmation over scans, or None."""
    needed: Any = config.confirmation_detections
    scans: Any = config.confirmation_scans
    if not isinstance(needed, int) or not isinstance(scans, int):
        return f"confirmation_detections and confirmation_scans: {needed!r} and {scans!r} are not whole numbers"
    if needed > scans:
        return f"confirmation_detections: {needed} detections do not fit into confirmation_scans: {scans}"
    return None


def strange_band_complaint(config: RadiometerConfig, bands: Sequence[str]) -> str | None:
    """Return the error in settings that name a band which the sensor does not have, or None.

    Default ratios of a model may name bands that a scene has replaced; these are ignored.
    """
    if config.reference_band not in ("", *bands) and config.reference_band != _default(config, "reference_band"):
        return f"reference_band: {config.reference_band} is not one of the sensor's bands, {', '.join(bands)}"
    for name in ("band_nei_w_m2", "plausible_ratios"):
        given = getattr(config, name)
        strange = [band for band in given if band not in bands]
        if strange and given != _default(config, name):
            return f"{name}: {strange[0]} is not one of the sensor's bands, {', '.join(bands)}"
    return None


def _default(config: RadiometerConfig, name: str) -> Any:
    default: Any = getattr(fields(type(config)), name).default
    return default.factory() if hasattr(default, "takes_self") else default
