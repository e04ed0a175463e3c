"""Parts of a plan that few scenes have; what builds them is imported for these scenes alone."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from attrs import evolve

from opir_core.host.host import Host
from opir_core.interfaces.sensors import Sensor
from opir_core.scene.scene import Scene

if TYPE_CHECKING:
    from opir_core.interfaces.directors import Director
    from opir_core.planning.faults import SensorFaults
    from opir_core.planning.links import Network


def faults_of(scene: Scene) -> "SensorFaults | None":
    """Return the faults of a scene's sensors; None without any."""
    if not scene.faults:
        return None
    from opir_core.planning.faults import SensorFaults

    return SensorFaults.of(scene)


def watching(sensor: Sensor, scene: Scene, faults: "SensorFaults | None") -> Sensor:
    """Return a sensor with the spans in which it looks by its scene, where it does not throughout,
    and those in which it looks at a part of its field of regard.
    """
    watched_s = scene.watched_s.get(sensor.id, sensor.watched_s)
    partial_s = sensor.partial_s
    if faults is not None:
        watched_s = faults.watched_s(sensor.id, watched_s, scene.duration_s)
        partial_s = faults.partial_s(sensor.id, scene.duration_s)
    if watched_s is None and not partial_s:
        return sensor
    return evolve(sensor, watched_s=watched_s, partial_s=partial_s)


def linked(
    scene: Scene, sensors: tuple[Sensor, ...]
) -> "tuple[tuple[Sensor, ...], Network | None]":
    """Return the sensors of a scene with the spans in which their reports do not arrive, so that
    their silence says nothing, and the scene's links; None without any.
    """
    if scene.links is None:
        return sensors, None
    from opir_core.planning.link_compiler import network_of

    links = network_of(scene, scene.links, sensors)
    heard = [
        evolve(sensor, partial_s=(*sensor.partial_s, *links.unheard_s(number)))
        for number, sensor in enumerate(sensors)
    ]
    return tuple(heard), links


def director_maker_of(
    scene: Scene, host: Host, sensors: tuple[Sensor, ...]
) -> "Callable[[], Director] | None":
    """Return what makes a scene's director; None without one."""
    if scene.director is None:
        return None
    from opir_core.planning.directors import director_maker

    return director_maker(scene, scene.director, host, sensors)
