"""What a scene may set of the built-in models. Nothing heavy is imported here."""

import math
from collections.abc import Mapping
from typing import Any

from attrs import Factory, frozen

from opir_core.scene.fields import DRAG, nested, number, text
from opir_core.scene.target_classes import TargetClass
from opir_core.sensors.confusion_matrix import Confusion, confusion_complaint

#: How far the sum of the confidence weights may be from 1.
WEIGHT_SUM_TOLERANCE = 1e-9

TYPE_HELP = "target class: ICBM, IRBM, SRBM, MRBM, SLBM, HGV, SLV, or that of a plugin"

PAPER_CONFIDENCE = (
    "opir-simulator paper (2026), section 4.3, names the weights and not their values; notional"
)


def _matrices_complaint(matrices: Mapping[str, Confusion]) -> str | None:
    for sensor_type, matrix in matrices.items():
        complaint = confusion_complaint(matrix)
        if complaint:
            return f"{sensor_type}: {complaint}"
    return None


@frozen
class ConstantConfig:
    """What a scene may set of the detection model `constant`."""

    band_confirmation: float = number(
        default=1.0,
        minimum=0.0,
        maximum=1.0,
        help="probability that each band confirms a detection, independently; if none does, the"
        " first confirms",
    )


@frozen
class ConfusionConfig:
    """What a scene may set of the classifier `paper`."""

    matrices: Mapping[str, Confusion] = nested(
        default=Factory(dict),
        check=_matrices_complaint,
        names_of=TargetClass.hook,
        names_depth=1,
        inner_names=("UNKNOWN",),
        source="by default each sensor's own confusion matrix",
        help="probabilities of each reported type, by sensor type and true target class; a row"
        " given here replaces the"
        " sensor's own row",
    )


@frozen
class WeightedConfig:
    """What a scene may set of the confidence model `weighted`; the weights sum to 1."""

    band: float = number(
        default=0.4,
        minimum=0.0,
        maximum=1.0,
        source=PAPER_CONFIDENCE,
        help="weight of the fraction of bands that confirm",
    )
    count: float = number(
        default=0.3,
        minimum=0.0,
        maximum=1.0,
        source=PAPER_CONFIDENCE,
        help="weight of the number of detections",
    )
    geometry: float = number(
        default=0.3,
        minimum=0.0,
        maximum=1.0,
        source=PAPER_CONFIDENCE,
        help="weight of the sine of the elevation",
    )

    def __attrs_post_init__(self) -> None:
        total = math.fsum((self.band, self.count, self.geometry))
        if abs(total - 1.0) > WEIGHT_SUM_TOLERANCE:
            raise ValueError(f"the weights band, count and geometry sum to {total:.10g}, not to 1")


def drag(where: str) -> Any:
    """Return the field of a target's ballistic coefficient, used `where` it flies freely."""
    meaning = f"m/(C_d A) {where} with drag; default: the scene's"
    return number(default=None, unit="kg/m²", minimum=1.0, maximum=1e6, help=meaning, subject=DRAG)


def _scene_time(meaning: str, default: float | None = None) -> Any:
    """Return the field of a time of the scene, s."""
    return number(default=default, unit="s", minimum=0.0, maximum=31_557_600.0, help=meaning)


@frozen
class PlaceConfig:
    """A place on the Earth."""

    lat_deg: float = number(
        unit="deg", minimum=-90.0, maximum=90.0, help="geodetic latitude (WGS 84)"
    )
    lon_deg: float = number(unit="deg", minimum=-180.0, maximum=180.0, help="east longitude")
    height_m: float = number(
        default=0.0,
        unit="m",
        minimum=-500.0,
        maximum=9000.0,
        help="height above the WGS 84 ellipsoid",
    )


@frozen
class LaunchConfig(PlaceConfig):
    """Where and when a target lifts off."""

    time_s: float = _scene_time("ignition time, in scene time", default=0.0)


@frozen(kw_only=True)
class AimConfig(PlaceConfig):
    """Where a target is to come down."""


@frozen
class BallisticConfig:
    """What a scene may set of a target of the model `ballistic`."""

    type: str = text(names_of=TargetClass.hook, help=TYPE_HELP)
    launch: LaunchConfig = nested(help="launch point and time")
    aim: AimConfig = nested(help="aim point")
    profile: str | None = text(
        default=None,
        help="boost profile; default: that of the target type for the range to the aim point",
    )
    burn_time_s: float | None = number(
        default=None,
        unit="s",
        minimum=10.0,
        maximum=1000.0,
        help="burn time; default: the profile's",
    )
    ballistic_coefficient_kg_m2: float | None = drag("in free flight")


@frozen
class JsonlConfig:
    """The settings of the sink `jsonl`."""

    path: str = text(
        help="file in an existing folder, overwritten (or appended to, with a spool); - is standard"
        " output",
        default="events.jsonl",
    )
    encoder: str = text(help="event encoder of the lines", default="forge")
    heartbeat_s: float | None = number(
        default=None,
        unit="s",
        minimum=0.01,
        maximum=3600.0,
        help="interval of lines that say which sensor watched, whatever it saw; without it there are"
        " none",
    )


@frozen
class MemoryConfig:
    """The settings of the sink `memory`."""

    encoder: str = text(help="event encoder of the events that are requested", default="forge")
