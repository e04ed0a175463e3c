"""What is built of a scene's `sources`, and the bands and the atmosphere in which they shine."""

from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any

from attrs import frozen

from opir_core.errors import ModelError, SceneError, nearest
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

#: The trajectories that have a launch, and its row there.
Launch = tuple[Trajectories, int]


@frozen(eq=False, repr=False)
class _Emitters(Sources):
    """What a source model has built."""

    ids: Sequence[str]
    trajectories: Trajectories
    signatures: Signatures


def distinct_bands(sensors: Sequence[Sensor]) -> tuple[Band, ...]:
    """Return the distinct bands of sensors, in order of first use."""
    return tuple(dict.fromkeys(band for sensor in sensors for band in sensor.bands))


def make_sources(
    scene: Scene, host: Host, sensors: Sequence[Sensor], launches: Mapping[str, Launch]
) -> tuple[Sources, ...]:
    """Return the built sources of each block of a scene, whose launches are given by id."""
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
            launched=partial(_launched, scene, launches, source.model.path),
        )
        owner = partial(owner_text, host, source.model)
        emitters = Sources.adopt(_built(host, source.model, context), owner)
        trajectories = Trajectories.adopt(emitters.trajectories, owner)
        sources.append(
            _Emitters(emitters.ids, trajectories, Signatures.adopt(emitters.signatures, owner))
        )
    return tuple(sources)


def _launched(scene: Scene, launches: Mapping[str, Launch], path: str, name: str) -> Launch:
    """Return the launch with an id.

    Raises a `SceneError` without problems for one that could not be built: that is a problem of the
    target.
    """
    if name in launches:
        return launches[name]
    ids = [target.id for target in scene.targets]
    if name in ids:
        raise SceneError([])
    known = ", ".join(ids) or "none"
    raise ModelError(f"{path}: {name!r} is no target{nearest(name, ids)}; targets are {known}")


def scene_atmosphere(scene: Scene, host: Host, bands: tuple[Band, ...]) -> Transmittance:
    """Return the atmosphere of a scene for bands."""
    context = AtmosphereContext(bands=bands, path=scene.atmosphere.path, seed=scene.seed)
    return Transmittance.adopt(
        _built(host, scene.atmosphere, context), partial(owner_text, host, scene.atmosphere)
    )


def _built(host: Host, choice: Choice, context: object) -> Any:
    return host.component(choice.hook, choice.name, choice.path).build(choice.config, context)
