"""Core's plugin of the directors `operator`, `round-robin`, `cue` and `information`; imported when one
is named, and without numpy.
"""

from collections.abc import Iterable
from typing import Any

from attrs import frozen

from opir_core.doors import deferred
from opir_core.host.components import DirectorModel
from opir_core.host.hookspecs import hookimpl
from opir_core.scene.fields import nested, number, text
from opir_core.sensors.pointed_sensor import place_complaint


def _places_complaint(places_deg: tuple[tuple[float, float], ...]) -> str | None:
    if not places_deg:
        return "at least one place is needed"
    return next(filter(None, map(place_complaint, places_deg)), None)


def _least_probability_launch() -> Any:
    return number(
        default=0.5,
        minimum=0.0,
        maximum=1.0,
        help="tracks with a smaller probability of a launch get no sensor; those whose tracker does"
        " not weigh it do",
    )


def _mode(words: str) -> Any:
    return text(
        default="",
        source="none: sensors stay in their modes",
        help=f"mode of sensors {words}; sensors without it stay as they are",
    )


@frozen
class RoundRobinConfig:
    """What a scene may set of the director `round-robin`."""

    places_deg: tuple[tuple[float, float], ...] = nested(
        unit="deg",
        check=_places_complaint,
        source="",
        help="places that sensors look at in turn, [latitude, east longitude] each",
    )
    dwell_s: float = number(
        default=20.0,
        unit="s",
        above=0.0,
        maximum=86_400.0,
        help="time from one place to the next, the turn of the sensor included",
    )
    mode: str = _mode("at the places")


@frozen
class CueConfig:
    """What a scene may set of the director `cue`."""

    interval_s: float = number(
        default=2.0, unit="s", minimum=0.01, maximum=3600.0, help="time between decisions"
    )
    dwell_s: float = number(
        default=20.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        help="least time on a track while another one waits",
    )
    hand_over_s: float = number(
        default=30.0,
        unit="s",
        minimum=0.0,
        maximum=3600.0,
        help="a track that its sensor will have lost in so long gets another sensor before",
    )
    mode: str = _mode("that follow a track")
    search_mode: str = _mode("without a track, which look where they did")
    least_probability_launch: float = _least_probability_launch()


@frozen
class InformationConfig:
    """What a scene may set of the director `information`."""

    interval_s: float = number(
        default=5.0, unit="s", minimum=0.01, maximum=3600.0, help="time between decisions"
    )
    horizon_s: float = number(
        default=30.0,
        unit="s",
        above=0.0,
        maximum=3600.0,
        help="looks of so long, turns left out, are compared",
    )
    acceleration_density_m2_s3: float = number(
        default=100.0,
        unit="m2/s3",
        minimum=0.0,
        maximum=1e6,
        help="density of the acceleration that widens a track between its last tick and the"
        " decision",
    )
    modes: tuple[str, ...] = nested(
        default=(),
        source="none: sensors stay in their modes",
        help="modes among which it chooses by the gain; sensors without any of them stay as they"
        " are",
    )
    least_probability_launch: float = _least_probability_launch()


@hookimpl
def opir_directors() -> Iterable[DirectorModel]:
    """Yield `operator`, `round-robin`, `cue` and `information`."""
    yield DirectorModel(
        name="operator",
        summary="sensors do what an operator has them do over HTTP, and nothing else",
        build=deferred("opir_core.builtin.directors.operator"),
    )
    yield DirectorModel(
        name="round-robin",
        summary="one place after the other",
        config=RoundRobinConfig,
        build=deferred("opir_core.builtin.directors.round_robin"),
    )
    yield DirectorModel(
        name="cue",
        summary="each sensor to a track that no other one follows, the least known first",
        config=CueConfig,
        build=deferred("opir_core.builtin.directors.cue"),
    )
    yield DirectorModel(
        name="information",
        summary="each sensor to the track of which its next looks tell most",
        config=InformationConfig,
        build=deferred("opir_core.builtin.information.information"),
    )
