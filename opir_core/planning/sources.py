"""What is built of a scene's `sources`, and the bands and the atmosphere in which they shine."""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

from attrs import frozen

from opir_core.host.boundary import owner_text
from opir_core.host.host import Host
from opir_core.interfaces.radiometric_models import (
    AtmosphereContext,
    Signatures,
    SourceContext,
    Sources,
    Transmittance,
)
from opir_core.interfaces.sensors import Band, Sensor
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.scene import Choice, Scene


@frozen(eq=False, repr=False)
class _Emitters(Sources):
    """What a source model has built."""

    ids: Sequence[str]
    trajectories: Trajectories
    signatures: Signatures


def distinct_bands(sensors: Sequence[Sensor]) -> tuple[Band, ...]:
    """Return the distinct bands of sensors, in order of first use."""
    return tuple(dict.fromkeys(band for sensor in sensors for band in sensor.bands))


def make_sources(scene: Scene, host: Host, sensors: Sequence[Sensor]) -> tuple[Sources, ...]:
    """Return the built sources of each block of a scene."""
    bands = distinct_bands(sensors)
    sources = list[Sources]()
    make_atmosphere = cache(partial(scene_atmosphere, scene, host, bands))
    for source in scene.sources:
        context = SourceContext(
            bands=bands,
            id=source.id,
            path=source.model.path,
            epoch_us=scene.epoch_us,
            duration_s=scene.duration_s,
            seed=scene.seed,
            make_atmosphere=make_atmosphere,
        )
        owner = partial(owner_text, host, source.model)
        emitters = Sources.adopt(_built(host, source.model, context), owner)
        trajectories = Trajectories.adopt(emitters.trajectories, owner)
        sources.append(
            _Emitters(emitters.ids, trajectories, Signatures.adopt(emitters.signatures, owner))
        )
    return tuple(sources)


def scene_atmosphere(scene: Scene, host: Host, bands: tuple[Band, ...]) -> Transmittance:
    """Return the atmosphere of a scene for bands."""
    context = AtmosphereContext(bands=bands, path=scene.atmosphere.path, seed=scene.seed)
    return Transmittance.adopt(
        _built(host, scene.atmosphere, context), partial(owner_text, host, scene.atmosphere)
    )


def _built(host: Host, choice: Choice, context: object) -> Any:
    return host.component(choice.hook, choice.name, choice.path).build(choice.config, context)
