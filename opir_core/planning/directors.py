"""The director of a scene: built, and refused where no sensor takes its commands."""

from collections.abc import Callable
from functools import partial
from typing import Any

from opir_core.errors import ModelError, Problem, SceneError
from opir_core.host.boundary import check_hint, owner_text
from opir_core.host.host import Host
from opir_core.interfaces.directors import Director, DirectorContext
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.built_parts import BuildProblems, built
from opir_core.scene.scene import BY_OBSERVATION, Choice, Scene


def director_maker(
    scene: Scene, choice: Choice, host: Host, sensors: tuple[Sensor, ...]
) -> Callable[[], Director]:
    """Return what makes a scene's director, after it has made one; raises `SceneError` where no sensor takes
    commands or the tracker is late.
    """
    if not any(sensor.pointing for sensor in sensors):
        words = "no sensor of the scene has a narrow field that can be pointed"
        raise SceneError([Problem(choice.path, words)])
    if scene.tracking_order != BY_OBSERVATION:
        words = f"a director needs tracking_order: {BY_OBSERVATION}; it gets late reports late"
        raise SceneError([Problem(choice.path, words)])
    context = DirectorContext(sensors=sensors, epoch_us=scene.epoch_us, duration_s=scene.duration_s)
    make = partial(_director, host, choice, context)
    problems = BuildProblems()
    with problems.of(choice.path):
        make()
    problems.require_none()
    return make


def _director(host: Host, choice: Choice, context: DirectorContext) -> Director:
    """Return a new director; raises `ModelError` if what its component builds is none."""
    director = Director.adopt(built(host, choice, context), partial(owner_text, host, choice))
    interval_s: Any = director.interval_s
    if not isinstance(interval_s, int | float) or not 0.0 < interval_s < float("inf"):
        raise ModelError(
            f"{owner_text(host, choice)}: interval_s is {interval_s!r}, not a positive number of"
            f" seconds; {check_hint(choice.name)}"
        )
    return director
