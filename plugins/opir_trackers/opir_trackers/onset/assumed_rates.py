"""The prior rates of what a track may be, with their sources."""

from attrs import fields_dict

from opir_core.plugin import AssumedRate
from opir_core.scene import info_of
from opir_trackers.configs import HypothesesConfig

#: What each rate is of, by the setting: classes of sources; the last is of all others.
_KINDS = {
    "launches_per_day": ("launch",),
    "ground_sources_per_day": ("fire", "fire front", "flare", "glint"),
    "bolides_per_day": ("bolide", "earth grazer"),
    "flashes_per_day": ("lightning",),
    "aircraft_per_day": ("aircraft",),
    "take_offs_per_day": ("aircraft",),
    "reentries_per_day": ("re-entry",),
    "others_per_day": (),
}


def assumed_rates(config: HypothesesConfig) -> list[AssumedRate]:
    """Return the rates of a tracker's settings."""
    return [
        AssumedRate(name, per_day, _source(config, name), _KINDS[name])
        for name, per_day in config.rates().items()
    ]


def _source(config: HypothesesConfig, name: str) -> str:
    """Return the source of a rate, and what it is within areas."""
    attribute = fields_dict(HypothesesConfig)[name]
    is_default = getattr(config, name) == attribute.default
    source = info_of(attribute).source if is_default else "set by the scene"
    within = [
        f"; within areas[{place}]: {area.rates[name]:g}"
        for place, area in enumerate(config.areas)
        if name in area.rates
    ]
    return source + "".join(within)
