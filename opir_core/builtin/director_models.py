"""Core's plugin of the directors `round-robin` and `cue`; imported when one is named, and without
numpy.
"""

from collections.abc import Iterable

from attrs import frozen

from opir_core.builtin.plugin import built_by
from opir_core.host.components import DirectorModel
from opir_core.host.hookspecs import hookimpl
from opir_core.scene.fields import nested, number
from opir_core.sensors.pointed_sensor import place_complaint


def _places_complaint(places_deg: tuple[tuple[float, float], ...]) -> str | None:
    if not places_deg:
        return "at least one place is needed"
    return next(filter(None, map(place_complaint, places_deg)), None)


@frozen(kw_only=True)
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


@frozen(kw_only=True)
class CueConfig:
    """What a scene may set of the director `cue`."""

    interval_s: float = number(
        default=2.0, unit="s", above=0.0, maximum=3600.0, help="time between decisions"
    )
    dwell_s: float = number(
        default=20.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        help="least time on a track while another one waits",
    )
    least_probability_launch: float = number(
        default=0.5,
        minimum=0.0,
        maximum=1.0,
        help="tracks with a smaller probability of a launch get no sensor; those whose tracker does"
        " not weigh it do",
    )


@hookimpl
def opir_directors() -> Iterable[DirectorModel]:
    """Yield `round-robin` and `cue`."""
    yield DirectorModel(
        name="round-robin",
        summary="one place after the other",
        config=RoundRobinConfig,
        build=built_by("directors", "round_robin"),
    )
    yield DirectorModel(
        name="cue",
        summary="each sensor to a track that no other one follows, the least known first",
        config=CueConfig,
        build=built_by("directors", "cue"),
    )
