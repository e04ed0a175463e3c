"""What is asked of a run becomes a plan, checked whole, before the run hears of it."""

from collections.abc import Mapping
from typing import Any

from attrs import evolve, frozen

from opir_core.errors import OpirError, Problem, SceneError
from opir_core.live.plan_updates import joined, scan_generations, without_those_over
from opir_core.planning.plan import Plan, compile_plan
from opir_core.plugin.host import Host
from opir_core.scene.reading import scene_from_mapping, scene_mapping
from opir_core.scene.scene import Choice, Scene
from opir_core.simulation.engine import Engine

_RESTART = "needs a restart"

#: Keys of a scene that a running one does not change, with the way to do it.
_FIXED = {
    "scene": _RESTART,
    "epoch": _RESTART,
    "duration_s": _RESTART,
    "seed": _RESTART,
    "light_time": _RESTART,
    "forces": _RESTART,
    "tracker": f"{_RESTART}: tracks would be lost",
    "sources": _RESTART,
}


class RestartError(OpirError):
    """Settings that a running scene cannot change."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, problems)))


@frozen(eq=False)
class Draft:
    """An engine ready to take over; `not_after_ns` is the latest moment it may, `reopened` the outputs that change."""

    engine: Engine
    lap: int
    not_after_ns: int | None = None
    reopened: tuple[Choice, ...] = ()
    base: Scene | None = None


def drafted_launch(plan: Plan, block: Mapping[str, Any], time_ns: int, lap: int) -> Draft:
    """Return the draft of one more target in a plan at a moment.

    `block` is as a scene's targets are, and read as these are. Raises `SceneError`, `PluginError` or `ModelError` as
    reading and planning a scene with it does.
    """
    scene = plan.scene
    ours = next((target for target in scene.targets if target.id == block.get("id")), None)
    if ours is not None:
        raise SceneError([Problem("targets[0].id", f"{ours.id} is the id of another target")], source="launch")
    mapping = {**scene_mapping(scene), "targets": [dict(block)], "outputs": []}
    read = scene_from_mapping(mapping, host=plan.host, source="launch")
    newcomers = compile_plan(evolve(scene, targets=read.targets, **_without_sources(scene)), plan.host)
    engine = Engine(joined(without_those_over(plan, time_ns), newcomers))
    return Draft(engine, lap, int(newcomers.targets.ignition_s.min() * 1e9))


def drafted_settings(plan: Plan, mapping: Mapping[str, Any], lap: int, first: Scene) -> Draft:
    """Return the draft of other settings of a plan; `mapping` is a scene's, without targets and sources.

    `first` is the scene of the first lap, whose epoch and seed the mapping repeats. Raises `SceneError` with all that
    is wrong, and `RestartError` with all settings that cannot change while the scene runs.
    """
    former = evolve(plan.scene, epoch_us=first.epoch_us, seed=first.seed)
    ours = scene_mapping(former)
    whole: dict[str, Any] = {**mapping, **{key: ours[key] for key in ("targets", "sources") if key in ours}}
    read = scene_from_mapping(whole, host=plan.host, source="settings")
    problems = _restart_problems(former, read)
    if problems:
        raise RestartError(problems)
    compiled = compile_plan(evolve(read, epoch_us=plan.scene.epoch_us, seed=plan.scene.seed), plan.host)
    generations = scan_generations(compiled, plan)
    changed = evolve(compiled, scan_generations=generations)
    base = evolve(read, targets=first.targets)
    return Draft(Engine(changed), lap, reopened=_reopened(plan.scene, read), base=base)


def _without_sources(scene: Scene) -> dict[str, Any]:
    """Return the change that leaves a scene without sources, which are no newcomers."""
    return {"sources": ()} if getattr(scene, "sources", ()) else {}


def _reopened(former: Scene, scene: Scene) -> tuple[Choice, ...]:
    both = zip(former.outputs, scene.outputs, strict=True)
    return tuple(now for before, now in both if now != before)


def _restart_problems(former: Scene, scene: Scene) -> list[Problem]:
    ours, theirs = scene_mapping(former), scene_mapping(scene)
    problems = [Problem(key, reason) for key, reason in _FIXED.items() if ours.get(key) != theirs.get(key)]
    names = [(sensor.id, sensor.constellation, sensor.model.name) for sensor in former.sensors]
    if names != [(sensor.id, sensor.constellation, sensor.model.name) for sensor in scene.sensors]:
        return [*problems, Problem("sensors", f"{_RESTART}: other sensors, or in another order")]
    problems += [
        Problem(f"{now.model.path}.{key}", f"{_RESTART} (sensor {now.id}): outputs are open for sensors as they are")
        for before, now in zip(former.sensors, scene.sensors, strict=True)
        for key in ("bands", "orbit", "orbital_slot_deg")
        if getattr(before.model.config, key, None) != getattr(now.model.config, key, None)
    ]
    return problems + _output_problems(former, scene)


def _output_problems(former: Scene, scene: Scene) -> list[Problem]:
    if [output.name for output in former.outputs] != [output.name for output in scene.outputs]:
        return [Problem("outputs", f"{_RESTART}: other outputs, or in another order")]
    return [
        Problem(now.path, f"{_RESTART}: opened anew it would overwrite {now.config.path!r}; give another path")
        for before, now in zip(former.outputs, scene.outputs, strict=True)
        if now != before and getattr(now.config, "path", None) and now.config.path == before.config.path
    ]


def plan_of_lap(base: Scene, host: Host, lap: int, lap_us: int) -> Plan:
    """Return the plan of a lap: the scene with its epoch moved on by that many laps and as many added to its seed."""
    scene = evolve(base, epoch_us=base.epoch_us + lap * lap_us, seed=(base.seed + lap) % 2**63)
    return compile_plan(scene, host)
