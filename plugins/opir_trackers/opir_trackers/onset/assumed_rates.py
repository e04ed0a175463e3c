"""The prior rates of what a track may be, with their sources."""

from attrs import fields

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
    rates = []
    for attribute in fields(HypothesesConfig):
        if attribute.name in _KINDS:
            per_day = getattr(config, attribute.name)
            is_default = per_day == attribute.default
            source = info_of(attribute).source if is_default else "set by the scene"
            rates.append(AssumedRate(attribute.name, per_day, source, _KINDS[attribute.name]))
    return rates
