"""The plan: what a scene needs, and nothing else.

`compile_plan` builds the components that the scene names, computes all trajectories in one batch, and finds which
sensor can see which target when. Whatever is not in the plan is not imported, computed or allocated later.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from attrs import evolve, field, frozen

from opir_core.errors import OpirError
from opir_core.interfaces.contexts import ModelContext, SensorContext, TargetContext, TrackerContext
from opir_core.interfaces.protocols import Classifier, Confidence, DetectionProbability, Sensor, Tracker, Trajectories
from opir_core.planning.targets import Targets, join_targets
from opir_core.planning.visibility import Pairs, Sightlines, compile_pairs
from opir_core.plugin.host import Host
from opir_core.random_streams.philox import Stream, stream_key, uniforms_of
from opir_core.scene.scene import Choice, Scene

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel
    from opir_core.planning.environment import RadiometricEnvironment
    from opir_core.planning.pointing_bias import PointingBias
    from opir_core.radiometry.protocols import Sources

_NS = 1_000_000_000


@frozen(eq=False, kw_only=True)
class Plan:
    """A scene made ready to run: built components, trajectories, and pairs of sensor and target with their looks."""

    scene: Scene
    host: Host
    sensors: tuple[Sensor, ...]
    targets: Targets
    pairs: Pairs
    sightlines: Sightlines
    detection: DetectionProbability
    classifier: Classifier
    confidence: Confidence
    #: What the first run steps; it remembers that run (`tracker_of_run`).
    tracker: Tracker
    bias: "PointingBias | None"
    end_ns: int
    #: How often each sensor's scans have been numbered anew; empty in a run whose scan rates never changed.
    scan_generations: tuple[int, ...] = ()
    #: What the scene's blocks of sources came to; their emitters stand behind the launches among the targets.
    sources: "tuple[Sources, ...]" = ()
    #: The tracker that the plan was made with, and those that have runs behind them; plans made from one another share.
    own_tracker: Tracker | None = None
    used_trackers: list[Tracker] = field(factory=list)


def compile_plan(scene: Scene, host: Host | None = None) -> Plan:
    """Return the plan of a scene, with components from `host` (by default, all that is installed).

    Raises `PluginError` for components that cannot be had and `SceneError` for targets that cannot fly as asked.
    """
    host = host or Host.discover()
    sensors = tuple(_sensor(scene, host, number) for number in range(len(scene.sensors)))
    sources = _sources(scene, host, sensors)
    targets = _targets(scene, host, sensors, sources)
    end_ns = round(scene.duration_s * _NS)
    starts = [_uniform(scene.seed, sensor.id, "scan-phase") for sensor in sensors]
    pairs, sightlines = compile_pairs(sensors, targets, starts, light_time=scene.light_time, end_ns=end_ns)
    tracker = _tracker(scene, host, sensors)
    return Plan(
        scene=scene,
        host=host,
        sensors=sensors,
        targets=targets,
        pairs=pairs,
        sightlines=sightlines,
        **_models(scene, host, _model_context(scene, host, sensors, targets, sources)),
        tracker=tracker,
        own_tracker=tracker,
        bias=drawn_bias(scene.seed, sensors),
        end_ns=end_ns,
        sources=sources,
    )


def with_targets(plan: Plan, targets: Targets, pairs: Pairs, sightlines: Sightlines) -> Plan:
    """Return a plan with other targets: its models are built for them, its sensors and its tracker stay the same."""
    context = _model_context(plan.scene, plan.host, plan.sensors, targets, plan.sources)
    models = _models(plan.scene, plan.host, context)
    return evolve(plan, targets=targets, pairs=pairs, sightlines=sightlines, **models)


def tracker_of_run(plan: Plan) -> Tracker:
    """Return the tracker that a run of a plan steps: the plan's, or a new one like it where that has a run behind it.

    Raises `OpirError` where another was put in the place of the plan's own and has a run behind it: how to make it anew
    is not known.
    """
    tracker = plan.tracker
    if tracker.cadence_s is None:
        return tracker
    if not any(each is tracker for each in plan.used_trackers):
        plan.used_trackers.append(tracker)
        return tracker
    if tracker is not plan.own_tracker:
        words = "has a run behind it, which it remembers; give a new one: attrs.evolve(plan, tracker=…)"
        raise OpirError(f"the tracker {type(tracker).__name__} that was put into this plan {words}")
    return _tracker(plan.scene, plan.host, plan.sensors)


def _model_context(
    scene: Scene, host: Host, sensors: tuple[Sensor, ...], targets: Targets, sources: "tuple[Sources, ...]"
) -> ModelContext:
    def make_environment() -> "RadiometricEnvironment":
        from opir_core.planning.environment import make_environment

        return make_environment(scene, host, sensors, targets, sources)

    return ModelContext(sensors=sensors, target_type_code=targets.type_code, make_environment=make_environment)


def _models(scene: Scene, host: Host, context: ModelContext) -> dict[str, Any]:
    """Return the models of detection, classification and confidence, as a plan names them."""
    detection = built(host, scene.detection, context)
    context = evolve(context, detection=detection)
    return {
        "detection": detection,
        "classifier": built(host, scene.classification, context),
        "confidence": built(host, scene.confidence, context),
    }


def _tracker(scene: Scene, host: Host, sensors: tuple[Sensor, ...]) -> Tracker:
    context = TrackerContext(
        sensors=sensors,
        epoch_us=scene.epoch_us,
        duration_s=scene.duration_s,
        forces=_forces(scene),
        light_time=scene.light_time,
    )
    tracker: Tracker = built(host, scene.tracker, context)
    if getattr(tracker, "cadence_s", 0.0) is not None:
        from opir_core.planning.build_errors import require_tracker

        require_tracker(host, scene.tracker, tracker)
    return tracker


def drawn_bias(seed: int, sensors: Sequence[Sensor]) -> "PointingBias | None":
    """Return the line-of-sight bias of sensors, or None where none of them has any."""
    if not any(sensor.line_of_sight_bias_sigma_rad for sensor in sensors):
        return None
    from opir_core.planning.pointing_bias import PointingBias

    return PointingBias.drawn(seed, sensors)


def built(host: Host, choice: Choice, context: Any) -> Any:
    """Return the working part of a component that a scene chose."""
    return _part(host, choice, choice.config, context)


def _part(host: Host, choice: Choice, config: Any, context: Any) -> Any:
    """Return what a component builds; raises `ModelError` that says whose it is where it cannot."""
    component = host.component(choice.hook, choice.name, choice.path)
    try:
        return component.build(config, context)
    except OpirError:
        raise
    except Exception as error:
        from opir_core.planning.build_errors import build_error

        raise build_error(host, choice, error) from error


def _sensor(scene: Scene, host: Host, number: int) -> Sensor:
    chosen = scene.sensors[number]
    sensor: Sensor = built(host, chosen.model, SensorContext(id=chosen.id, epoch_us=scene.epoch_us))
    return sensor


def _sources(scene: Scene, host: Host, sensors: Sequence[Sensor]) -> "tuple[Sources, ...]":
    """Return what each block of sources comes to."""
    if not scene.sources:
        return ()
    from opir_core.planning.environment import make_sources

    return make_sources(scene, host, sensors)


def _targets(scene: Scene, host: Host, sensors: Sequence[Sensor], sources: "Sequence[Sources]") -> Targets:
    """Return all targets, each model's in one batch: the scene's launches, then the emitters of its sources."""
    rows: dict[str, list[int]] = {}
    for place, target in enumerate(scene.targets):
        rows.setdefault(target.model.name, []).append(place)
    free_flight = any(sensor.follows_bodies for sensor in sensors)
    trajectories = [_trajectories(scene, host, places, free_flight) for places in rows.values()]
    ids, places = [target.id for target in scene.targets], [*rows.values()]
    for source in sources:
        places.append(list(range(len(ids), len(ids) + len(source.ids))))
        ids += source.ids
        trajectories.append(source.trajectories)
    return join_targets(ids, trajectories, places)


def _trajectories(scene: Scene, host: Host, places: Sequence[int], free_flight: bool) -> Trajectories:
    chosen = [scene.targets[place] for place in places]
    context = TargetContext(
        ids=tuple(target.id for target in chosen),
        paths=tuple(target.model.path for target in chosen),
        forces=_forces(scene),
        epoch_us=scene.epoch_us,
        free_flight=free_flight,
    )
    configs = [target.model.config for target in chosen]
    trajectories: Trajectories = _part(host, chosen[0].model, configs, context)
    return trajectories


def _forces(scene: Scene) -> "ForceModel":
    """Return what acts in free flight; for two-body motion nothing is imported."""
    if scene.forces.is_kepler:
        return "kepler"
    from opir_core.flight.forces import chosen_forces

    return chosen_forces(scene.forces)


def _uniform(seed: int, *names: str) -> float:
    return float(uniforms_of(Stream(stream_key(seed, *names)).words(0, 1))[0])
