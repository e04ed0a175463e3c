"""The keys of a scene file, with what each means; the blocks among them are read later, by what
they choose.
"""

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from attrs import Factory, frozen

from opir_core.reading.nodes import MAXIMUM_DURATION_S, MAXIMUM_NAME_LENGTH, Node
from opir_core.scene.faults import SensorFault
from opir_core.scene.fields import flag, nested, number, text
from opir_core.scene.scene import (
    BY_OBSERVATION,
    BY_REPORT,
    CLASS_TYPES,
    PAPER_TYPES,
    PLAUSIBLE_DURATION_S,
    WorkLimits,
)

#: The detection model that the scene itself decides: the one that reads light, or the one without
#: light.
AUTO = "auto"
WITHOUT_LIGHT = "constant"

#: The keys that choose one component: the hook it comes through, and the name chosen where the
#: scene has none.
CHOICES = {
    "detection": ("opir_detection_models", AUTO),
    "classification": ("opir_classifiers", "paper"),
    "confidence": ("opir_confidence_models", "weighted"),
    "tracker": ("opir_trackers", "none"),
    "atmosphere": ("opir_atmosphere_models", "clear"),
    "background": ("opir_background_models", "none"),
}

#: The preset of a scene with the sensors and the conventions of the paper.
PAPER = "paper"

#: The target model of a target that names none.
DEFAULT_TARGET_MODEL = "ballistic"


def _name_complaint(name: str) -> str | None:
    if not name.strip() or "\n" in name:
        return "a scene's name is one line of text"
    too_long = len(name) > MAXIMUM_NAME_LENGTH
    return (
        f"a scene's name has at most {MAXIMUM_NAME_LENGTH} characters; this has {len(name)}"
        if too_long
        else None
    )


def _epoch_complaint(epoch: str) -> str | None:
    try:
        epoch_us_of_text(epoch)
    except ValueError as error:
        return str(error)
    return None


def _spans_complaint(watched_s: Mapping[str, tuple[tuple[float, float], ...]]) -> str | None:
    for sensor, spans in watched_s.items():
        previous_s = 0.0
        for start_s, end_s in spans:
            if not previous_s <= start_s < end_s:
                return (
                    f"{sensor}: {start_s:g} to {end_s:g} s is no span after {previous_s:g} s; give"
                    " spans in order, without overlap"
                )
            previous_s = end_s
    return None


def _chosen(kind: str, key: str) -> dict[str, Any]:
    words = f"{kind}: its name, or a block of model and settings"
    more = {
        "classification": ", or that of the detection model",
        "detection": f": the model that reads light if the scene describes light, else"
        f" `{WITHOUT_LIGHT}`",
    }
    return {
        "help": words,
        "default": None,
        "source": f"`{CHOICES[key][1]}` if none is named{more.get(key, '')}",
    }


@frozen
class SceneFile:
    """A scene as its file has it, its blocks unread."""

    scene: str = nested(help="the scene's name", check=_name_complaint, source="")
    epoch: str = nested(
        help="start of scene time, RFC 3339 in UTC, years 1970 to 2099, microseconds at most",
        check=_epoch_complaint,
        source="",
    )
    duration_s: float = number(
        help="duration of the scene",
        unit="s",
        above=0.0,
        maximum=MAXIMUM_DURATION_S,
        plausible=PLAUSIBLE_DURATION_S,
        source="",
    )
    seed: int = number(
        help="seed of all random numbers",
        default=0,
        minimum=0,
        maximum=2**63 - 1,
        source="arbitrary",
    )
    light_time: bool = flag(
        help="whether light travels at finite speed",
        default=True,
        source="physics: 0.12 s to geostationary height; preset paper: false",
    )
    preset: str | None = text(
        help="preset from which each component that has it starts, unless its block names another",
        default=None,
        choices=(PAPER, "heritage"),
        source="none",
    )
    reported_types: str = text(
        help="what events report: the types ICBM, IRBM, SRBM and UNKNOWN (paper), or target classes"
        " too (classes)",
        default=PAPER_TYPES,
        choices=(PAPER_TYPES, CLASS_TYPES),
        source="opir-simulator paper (2026): four types",
    )
    forces: Node | None = nested(
        help="forces in free flight: kepler (point mass only), or a list of j2, j3, j4 and drag",
        default=None,
        source="opir-simulator paper (2026): two-body motion",
    )
    limits: WorkLimits = nested(
        help="the most work that is accepted; a scene above it is rejected before it runs",
        default=WorkLimits(),
        source="derived: see each",
    )
    allow_implausible: bool = flag(
        help="whether values outside their plausible range are accepted without a warning",
        default=False,
        source="choice",
    )
    sensors: Node = nested(help="constellations and single sensors", source="")
    watched_s: Mapping[str, tuple[tuple[float, float], ...]] = nested(
        help="by sensor the spans in which it looks, [start, end] each, in order: outside of them"
        " it detects nothing, and a tracker knows that nobody looked; other sensors look throughout",
        default=Factory(dict),
        unit="s",
        minimum=0.0,
        check=_spans_complaint,
        source="choice",
    )
    faults: tuple[SensorFault, ...] = nested(
        help="faults of sensors, each from a time on and, with a repair, until another",
        default=(),
        source="choice",
    )
    links: Node | None = nested(
        help="links: ground stations, relays and queues on the way of reports to the ground",
        default=None,
        source="none: reports arrive after the latencies of `reporting`",
    )
    director: Node | None = nested(
        help="director: points sensors with a narrow field during the run; its name, or a block of"
        " model and settings; none for no director",
        default=None,
        source="none: sensors stay as they are",
    )
    targets: Node | None = nested(help="launches", default=None, source="")
    sources: Node | None = nested(
        help="emitters other than targets: fires, aircraft, lightning and more",
        default=None,
        source="",
    )
    detection: Node | None = nested(**_chosen("detection model", "detection"))
    classification: Node | None = nested(**_chosen("classifier", "classification"))
    confidence: Node | None = nested(**_chosen("confidence model", "confidence"))
    tracker: Node | None = nested(**_chosen("tracker", "tracker"))
    tracking_order: str = text(
        help="order in which the tracker gets detections: of observation, as if reports had no"
        " latency, or of report,"
        " by a fixed lag",
        default=BY_OBSERVATION,
        choices=(BY_OBSERVATION, BY_REPORT),
        source="opir-simulator paper (2026): event time",
    )
    tracking_lag_s: float | None = number(
        help="time after a tick at which the tracker is stepped in the order of report, with the"
        " detections reported by"
        " then; later reports are not tracked",
        default=None,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        source="derived: the sum over the stages of the slowest sensor of the latency that one"
        " report in 1000 exceeds",
    )
    atmosphere: Node | None = nested(**_chosen("atmosphere model", "atmosphere"))
    background: Node | None = nested(**_chosen("background model", "background"))
    outputs: Node | None = nested(
        help="sinks: a list of names, or of names with their settings", default=None, source=""
    )


_FIRST_YEAR = 1970
_LAST_YEAR = 2099
_START = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_FORM = re.compile(
    r"(\d{4})-(\d{2})-(\d{2})T(\d{2}):(\d{2}):(\d{2})(?:\.(\d+))?(Z|[-+]\d{2}:\d{2})?", re.ASCII
)
#: RFC 3339 writes UTC in these ways; programs that format times often write the second.
_UTC = ("Z", "+00:00", "-00:00")
_EXAMPLE = "2026-04-01T12:00:00Z"


def epoch_us_of_text(text: str) -> int:
    """Return microseconds since 1970-01-01 UTC (no leap seconds) of
    `YYYY-MM-DDThh:mm:ss[.ffffff]Z`, or with the offset 00:00 for Z.

    Raises `ValueError`, with words for the user, for any other form, for a moment that does not
    exist (a leap second is none here) and for years outside 1970 to 2099.
    """
    match = _FORM.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a time; write it like {_EXAMPLE}")
    *date, fraction, zone = match.groups()
    if zone not in _UTC:
        raise ValueError(
            f"{text!r} is not in UTC; write the time in UTC, ended by Z, like {_EXAMPLE}"
        )
    if fraction and len(fraction) > 6:
        raise ValueError(f"{text!r} is finer than a microsecond")
    try:
        moment = datetime(*(int(number) for number in date), tzinfo=UTC)  # type: ignore[misc,arg-type]
    except ValueError as error:
        raise ValueError(f"{text!r} is not a time that exists") from error
    if not _FIRST_YEAR <= moment.year <= _LAST_YEAR:
        raise ValueError(f"{text!r} is outside the years {_FIRST_YEAR} to {_LAST_YEAR}")
    return (moment - _START) // _MICROSECOND + int((fraction or "").ljust(6, "0"))


def text_of_epoch_us(epoch_us: int) -> str:
    """Return `YYYY-MM-DDThh:mm:ss[.ffffff]Z` for microseconds since 1970-01-01 UTC."""
    moment = _START + epoch_us * _MICROSECOND
    return (
        f"{moment:%Y-%m-%dT%H:%M:%S}{f'.{moment.microsecond:06d}' if moment.microsecond else ''}Z"
    )
