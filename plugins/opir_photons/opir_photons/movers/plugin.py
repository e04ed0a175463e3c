"""Sources that move or flash, as blocks of a scene's `sources`; each is built by a module that its
use imports.
"""

from collections.abc import Iterable

from opir_core.plugin import SourceModel, deferred, hookimpl
from opir_photons.movers.configs import (
    AircraftConfig,
    BalloonConfig,
    FireFrontConfig,
    GrazerConfig,
    ReentryConfig,
    SatelliteConfig,
    ShipConfig,
    SpentStagesConfig,
    StormConfig,
    TrainConfig,
)

#: Name, summary and configuration of each model, and the function that builds it, with its module.
_MODELS = (
    ("ships", "ships that steam straight on; grey funnels", ShipConfig, "courses.ship_sources"),
    ("trains", "trains that run straight on; grey exhausts", TrainConfig, "courses.train_sources"),
    (
        "fire_fronts",
        "fronts of fire that creep over the ground; flat grey bodies",
        FireFrontConfig,
        "courses.fire_front_sources",
    ),
    (
        "balloons",
        "balloons that drift with the wind in the sunlight",
        BalloonConfig,
        "sunlit.balloon_sources",
    ),
    (
        "satellites",
        "satellites on circular orbits in the sunlight",
        SatelliteConfig,
        "sunlit.satellite_sources",
    ),
    (
        "aircraft",
        "aircraft that climb, turn and speed up leg by leg, with and without afterburner",
        AircraftConfig,
        "aircraft.aircraft_sources",
    ),
    (
        "reentries",
        "bodies that enter the air unpowered, slowed by drag, as hot as it makes them",
        ReentryConfig,
        "falls.reentry_sources",
    ),
    (
        "spent_stages",
        "stages that a launch of the scene drops, in the sunlight and hot from burn and air",
        SpentStagesConfig,
        "stages.spent_stage_sources",
    ),
    ("grazers", "meteors that graze the air and leave it", GrazerConfig, "falls.grazer_sources"),
    (
        "storms",
        "thunderstorms: flashes of lightning at random times, of random strokes and energies",
        StormConfig,
        "storms.storm_sources",
    ),
)


@hookimpl
def opir_source_models() -> Iterable[SourceModel]:
    """Yield what moves over the ground, what falls through the air, and lightning."""
    for name, summary, config, place in _MODELS:
        yield SourceModel(
            name=name,
            summary=summary,
            config=config,
            build=deferred(f"opir_photons.movers.{place}"),
        )
