"""The radiometric part of a scanning sensor's configuration."""

from collections.abc import Mapping, Sequence
from typing import Any

from attrs import Factory, evolve, fields, fields_dict, frozen

from opir_core.interfaces.focal_plane import FocalPlaneConfig
from opir_core.scene.fields import LIGHT, nested, number, text

#: Bounds come in twos.
_PAIR = 2


def _ratios_complaint(ratios: Any) -> str | None:
    for name, bounds in ratios.items():
        if len(bounds) != _PAIR or bounds[0] >= bounds[1]:
            return f"{name}: {bounds!r} is not [least, most] with least < most"
    return None


#: The condition of settings of rules that compare bands.
_COMPARED = (
    "with spectral_discrimination: dual-band-ratio or triple-coincidence",
    lambda config: config.spectral_discrimination in ("dual-band-ratio", "triple-coincidence"),
)


@frozen
class RadiometerConfig:
    """What a scene may set of how a sensor measures light, for models that reckon with it
    (detection: snr).
    """

    nei_w_m2: float | None = number(
        default=None,
        unit="W/m²",
        minimum=0.0,
        maximum=1e6,
        source="no default: computed from the focal plane",
        help="noise-equivalent irradiance of a look without background, in each band, in place of"
        " what dark current,"
        " warm optics, reading and conversion come to",
        subject=LIGHT,
    )
    nei_w_cm2: float | None = number(
        default=None,
        unit="W/cm²",
        minimum=0.0,
        maximum=1e2,
        source="no default: nei_w_m2",
        help="the same in W/cm²; a scene sets one of the two",
        instead_of="nei_w_m2",
        subject=LIGHT,
    )
    band_nei_w_m2: Mapping[str, float] = nested(
        default=Factory(dict),
        unit="W/m²",
        minimum=0.0,
        maximum=1e6,
        source="no default: nei_w_m2",
        help="by band the noise-equivalent irradiance of bands that have their own",
        keys_of="bands",
        subject=LIGHT,
    )
    ifov_urad: float = number(
        default=28.0,
        unit="urad",
        above=0.0,
        maximum=1e5,
        help="angle across a pixel; 28 are 1 km from 36 000 km",
        subject=LIGHT,
    )
    collection_m2_s: float = number(
        default=0.007,
        unit="m² s",
        above=0.0,
        maximum=1e6,
        help="aperture times efficiency times integration time, for focal_plane: null",
        subject=LIGHT,
        read_if=("with focal_plane: null", lambda config: config.focal_plane is None),
    )
    threshold_sigma: float = number(
        default=5.0,
        minimum=0.0,
        maximum=1e3,
        source="opir-simulator paper (2026), section 2.4",
        help="signal over noise above which a look detects",
        subject=LIGHT,
    )
    false_alarm_probability: float | None = number(
        default=None,
        above=0.0,
        below=1.0,
        plausible=(1e-15, 0.1),
        source="no default: threshold_sigma",
        help="chance that noise alone crosses the threshold, in a resolution cell and look; a scene"
        " sets this or the"
        " threshold",
        instead_of="threshold_sigma",
        subject=LIGHT,
    )
    coincidence_sigma: float = number(
        default=3.0,
        minimum=0.0,
        maximum=1e3,
        help="signal over noise that the other bands need where bands are compared, and that any"
        " band needs to confirm"
        " where they are summed",
        subject=LIGHT,
        read_if=(
            "unless spectral_discrimination: none",
            lambda config: config.spectral_discrimination != "none",
        ),
    )
    reference_band: str = text(
        default="",
        source="no default: the shortest band",
        help="the band that has to cross the threshold where bands are compared, and to which the"
        " plausible ratios"
        " refer",
        subject=LIGHT,
        read_if=_COMPARED,
    )
    plausible_ratios: Mapping[str, tuple[float, float]] = nested(
        default=Factory(dict),
        minimum=0.0,
        check=_ratios_complaint,
        help="by band [least, most] intensity over that of the reference band at the source, where"
        " bands are compared;"
        " the sensor widens these bounds by what the air does to the ratio at any height of the"
        " source",
        keys_of="bands",
        subject=LIGHT,
        read_if=_COMPARED,
    )
    ratio_tolerance_sigma: float = number(
        default=3.0,
        minimum=0.0,
        maximum=1e3,
        source="a plume on a bound is refused with probability Q(3) = 0.0013",
        help="how far noise may carry a measurement beyond the plausible ratios, in standard"
        " deviations",
        subject=LIGHT,
        read_if=_COMPARED,
    )
    confirmation_detections: int = number(
        default=2,
        minimum=1,
        maximum=8,
        help="detections that the sensor needs before it reports the last of them, for detection:"
        " snr; 1 reports all",
        subject=LIGHT,
    )
    confirmation_scans: int = number(
        default=3,
        minimum=1,
        maximum=64,
        help="successive scans among which these detections must be, the last one included",
        subject=LIGHT,
    )
    confirmation_speed_m_s: float = number(
        default=8000.0,
        unit="m/s",
        minimum=0.0,
        maximum=1e5,
        source="above the circular speed at a height of 200 km, 7784 m/s",
        help="speed that a source may have for detections of several scans to be taken for one"
        " source",
        subject=LIGHT,
    )
    focal_plane: FocalPlaneConfig | None = nested(
        default=FocalPlaneConfig(),
        named_values={"notional": FocalPlaneConfig()},
        help="optics, detectors, filters and jitter, from which NEI, clutter, saturation and the"
        " accuracy of lines of"
        " sight follow; notional: the sensor model's own made-up values; null: nei_w_m2 and"
        " collection_m2_s alone, and"
        " the background's clutter_residual",
        subject=LIGHT,
    )
    band_focal_plane: Mapping[str, Mapping[str, float]] = nested(
        default=Factory(dict),
        source="no default: focal_plane",
        help="by band, numbers of focal_plane that differ in it",
        keys_of="bands",
        subject=LIGHT,
    )


def focal_plane_complaint(config: RadiometerConfig, bands: Sequence[str]) -> str | None:
    """Return the error in a focal plane beside the sensor's other settings, or None."""
    names = {
        name
        for name, field_ in fields_dict(FocalPlaneConfig).items()
        if field_.type in (float, int, float | None)
    }
    # Frames are subtracted from one another in all bands alike.
    names -= {"lag_s", "registration_urad", "drift_urad_s"}
    changes: Any = config.band_focal_plane
    for settings in changes.values():
        if unknown := sorted(set(settings) - names):
            return (
                f"band_focal_plane: {unknown[0]} is no setting of focal_plane; known:"
                f" {', '.join(sorted(names))}"
            )
        # A value out of range is a `ValueError` with its name.
        evolve(FocalPlaneConfig(), **settings)
    if (
        config.focal_plane is not None
        or config.nei_w_m2 is not None
        or config.nei_w_cm2 is not None
    ):
        return None
    return (
        None
        if set(bands) <= set(config.band_nei_w_m2)
        else "focal_plane: without one set the noise, nei_w_m2"
    )


def confirmation_complaint(config: RadiometerConfig) -> str | None:
    """Return the error in the settings of the confirmation over scans, or None."""
    needed: Any = config.confirmation_detections
    scans: Any = config.confirmation_scans
    if not isinstance(needed, int) or not isinstance(scans, int):
        return (
            f"confirmation_detections and confirmation_scans: {needed!r} and {scans!r} are not"
            f" whole numbers"
        )
    if needed > scans:
        return (
            f"confirmation_detections: {needed} detections do not fit into confirmation_scans:"
            f" {scans}"
        )
    return None


def unknown_band_complaint(config: RadiometerConfig, bands: Sequence[str]) -> str | None:
    """Return the error in settings that name a band which the sensor does not have, or None.

    Default ratios of a model may name bands that a scene has replaced; these are ignored.
    """
    if config.reference_band not in ("", *bands) and config.reference_band != _default(
        config, "reference_band"
    ):
        return (
            f"reference_band: {config.reference_band} is not one of the sensor's bands,"
            f" {', '.join(bands)}"
        )
    for name in ("band_nei_w_m2", "band_focal_plane", "plausible_ratios"):
        by_band = getattr(config, name)
        unknown = [band for band in by_band if band not in bands]
        if unknown and by_band != _default(config, name):
            return f"{name}: {unknown[0]} is not one of the sensor's bands, {', '.join(bands)}"
    return None


def _default(config: RadiometerConfig, name: str) -> Any:
    default: Any = getattr(fields(type(config)), name).default
    return default.factory() if hasattr(default, "takes_self") else default
