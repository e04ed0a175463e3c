"""Sources that move or flash, as blocks of a scene's `sources`; each is built by a module that its
use imports.
"""

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

from opir_core.plugin import SourceModel, hookimpl
from opir_photons.movers.configs import (
    AircraftConfig,
    BalloonConfig,
    FireFrontConfig,
    GrazerConfig,
    ReentryConfig,
    ShipConfig,
    StormConfig,
    TrainConfig,
)


def _built_by(module: str, function: str) -> Callable[..., Any]:
    """Return a `build` that imports its module of this package when it is called."""

    def build(config: Any, context: Any) -> Any:
        return getattr(import_module(f"opir_photons.movers.{module}"), function)(config, context)

    return build


@hookimpl
def opir_source_models() -> Iterable[SourceModel]:
    """Yield what moves over the ground, what falls through the air, and lightning."""
    yield SourceModel(
        name="ships",
        summary="ships that steam straight on; funnels as grey bodies",
        config=ShipConfig,
        build=_built_by("courses", "ship_sources"),
    )
    yield SourceModel(
        name="trains",
        summary="trains that run straight on; exhausts as grey bodies",
        config=TrainConfig,
        build=_built_by("courses", "train_sources"),
    )
    yield SourceModel(
        name="fire_fronts",
        summary="fronts of fire that creep over the ground; flat grey bodies",
        config=FireFrontConfig,
        build=_built_by("courses", "fire_front_sources"),
    )
    yield SourceModel(
        name="balloons",
        summary="balloons that drift with the wind in the sunlight",
        config=BalloonConfig,
        build=_built_by("balloons", "balloon_sources"),
    )
    yield SourceModel(
        name="aircraft",
        summary="aircraft that climb, turn and speed up leg by leg, with and without afterburner",
        config=AircraftConfig,
        build=_built_by("aircraft", "aircraft_sources"),
    )
    yield SourceModel(
        name="reentries",
        summary="bodies that enter the air unpowered, slowed by drag, as hot as it makes them",
        config=ReentryConfig,
        build=_built_by("falls", "reentry_sources"),
    )
    yield SourceModel(
        name="grazers",
        summary="meteors that graze the air and leave it",
        config=GrazerConfig,
        build=_built_by("falls", "grazer_sources"),
    )
    yield SourceModel(
        name="storms",
        summary="thunderstorms: flashes of lightning at random times, of random strokes and energies",
        config=StormConfig,
        build=_built_by("storms", "storm_sources"),
    )
