"""The plan: a scene compiled to built components, trajectories, and pairs of sensor and target with
their looks.

What is not in the plan is not imported, computed or allocated later.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import asdict, evolve, field, frozen

from opir_core.arrays import ByteArray
from opir_core.errors import ModelError, kind_of, number_of
from opir_core.host.boundary import PluginErrors, blamed_call, check_hint, owner_text
from opir_core.host.host import Host
from opir_core.interfaces.classification import Classifier, Confidence
from opir_core.interfaces.contexts import (
    ModelContext,
    PartMaker,
    SensorContext,
    Surroundings,
    TargetContext,
    TrackerContext,
)
from opir_core.interfaces.detection_models import DetectionProbability
from opir_core.interfaces.records import CommandRecord
from opir_core.interfaces.sensors import Sensor
from opir_core.interfaces.trackers import Tracker
from opir_core.interfaces.trajectories import Trajectories
from opir_core.notebook import html_view
from opir_core.planning.built_parts import (
    BuildProblems,
    built,
    motion_fault,
    sensor_fault,
    tracker_fault,
    trajectories_fault,
)
from opir_core.planning.looks import LookGeometry
from opir_core.planning.optional_parts import director_maker_of, faults_of, linked, watching
from opir_core.planning.pair_compiler import PairCompiler
from opir_core.planning.partial_looks import stated_sensors
from opir_core.planning.reported_types import (
    offered_hypotheses,
    paper_codes,
    reported_types,
    sensors_of_trackers,
)
from opir_core.planning.sensor_states import PointingBias, SensorStates, scan_starts
from opir_core.planning.sightlines import Pairs, Sightlines
from opir_core.planning.solar_exclusion import SolarExclusion, solar_exclusions
from opir_core.planning.targets import Targets, join_targets
from opir_core.planning.work import Workload
from opir_core.scene.fields import LIGHT
from opir_core.scene.hypotheses import Hypothesis
from opir_core.scene.scene import REPORTED_TYPES, Choice, Scene
from opir_core.scene.target_classes import TargetClass

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel
    from opir_core.interfaces.directors import Director
    from opir_core.interfaces.radiometric_models import Sources
    from opir_core.planning.faults import SensorFaults
    from opir_core.planning.links import Network


@frozen(eq=False, kw_only=True, repr=False)
class PlanParts:
    """The built components of a scene: a plan without pairs, lines of sight and solar
    exclusions.
    """

    scene: Scene
    host: Host
    sensors: tuple[Sensor, ...]
    targets: Targets
    detection: DetectionProbability
    classifier: Classifier
    confidence: Confidence
    #: Returns a new tracker.
    make_tracker: Callable[[], Tracker]
    #: Called with the message when a tracker fails, and the run goes on without it; None: the run
    #: fails.
    on_tracker_error: Callable[[str], None] | None = None
    bias: PointingBias | None
    end_ns: int
    #: Returns a new director; None for a scene without one.
    make_director: "Callable[[], Director] | None" = None
    #: The faults of the sensors; None without any.
    faults: "SensorFaults | None" = None
    #: The links by which reports get to the ground; None without any.
    links: "Network | None" = None
    #: The built `sources` of the scene; their emitters follow the launches in `targets`.
    sources: "tuple[Sources, ...]" = ()
    #: The names of the types that events report, by code.
    reported_types: tuple[str, ...] = REPORTED_TYPES

    @property
    def has_latency(self) -> bool:
        """Whether reports come later than their looks."""
        return self.links is not None or any(sensor.reporting for sensor in self.sensors)

    @property
    def link_paths(self) -> tuple[tuple[str, ...], ...]:
        """The ways of reports to the ground, by number: the nodes after the sensor."""
        return () if self.links is None else tuple(path.hops for path in self.links.paths)

    def pair_compiler(self, exclusions: Sequence[SolarExclusion | None]) -> PairCompiler:
        """Return the compiler of the pairs of sensors and targets."""
        starts = scan_starts(self.scene.seed, self.sensors)
        return PairCompiler(
            self.sensors, self.targets, starts, self.scene.light_time, self.end_ns, exclusions
        )

    def solar_exclusions(self) -> tuple[SolarExclusion | None, ...]:
        """Return the sensors' solar exclusions; empty if none of them has any."""
        return solar_exclusions(self.sensors, self.scene.epoch_us, self.scene.duration_s)

    def work_of(self, pairs: Pairs) -> Workload:
        """Return the workload of pairs in place of those of a plan."""
        return Workload(pairs, self.sensors, self.detection, self.end_ns, self.scene.limits)


@frozen(eq=False, kw_only=True, repr=False)
class Plan(PlanParts):
    """A compiled scene. A plan does not change while it runs: each run gets a tracker of its own
    from `make_tracker`.

    To run a tracker object of your own: `attrs.evolve(plan, make_tracker=lambda: MyTracker())`.
    """

    pairs: Pairs
    sightlines: Sightlines
    #: How often each sensor's scans were renumbered; empty if the scan rates never changed.
    scan_generations: tuple[int, ...] = ()
    #: The sensors' solar exclusions; empty if none of them has any.
    exclusions: tuple[SolarExclusion | None, ...] = ()
    #: What runs have computed from this plan that no seed changes, by subject; `reseeded` plans
    #: share it.
    kept: dict[str, Any] = field(factory=dict)

    def __repr__(self) -> str:
        """Return the plan in one line."""
        counts = {
            "sensor": len(self.sensors),
            "target": len(self.targets.ids),
            "pair": len(self.pairs),
        }
        of = ", ".join(number_of(noun, count) for noun, count in counts.items())
        return (
            f"<Plan of {self.scene.name}: {of}, {self.end_ns * 1e-9:g} s, seed {self.scene.seed}>"
        )

    def _repr_html_(self) -> str:
        """Return the sensors with their looks at targets for a notebook."""
        looks = np.bincount(self.pairs.sensor, self.pairs.looks, minlength=len(self.sensors))
        rows = [
            (sensor.id, sensor.type, int(count))
            for sensor, count in zip(self.sensors, looks, strict=True)
        ]
        return html_view(self, ("sensor", "type", "looks"), rows)

    @property
    def has_independent_windows(self) -> bool:
        """Whether several processes can compute its windows: what a director decides depends on
        those before.
        """
        return self.make_director is None

    @property
    def workload(self) -> Workload:
        """The workload of the plan, which gives its looks, events and bytes."""
        return self.work_of(self.pairs)

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """What a hot object may be, from all target classes that plugins offer."""
        if "hypotheses" not in self.kept:
            self.kept["hypotheses"] = offered_hypotheses(self.host)
        return self.kept["hypotheses"]

    @property
    def hypothesis_names(self) -> tuple[str, ...]:
        """The names of the hypotheses, in the order of `Tracks.hypothesis_probability`."""
        return tuple(hypothesis.name for hypothesis in self.hypotheses)

    def paper_codes(self) -> ByteArray | None:
        """Return the codes (n,) into `REPORTED_TYPES` of the reported types, or None where they are
        these types.
        """
        is_paper = self.reported_types == REPORTED_TYPES
        return None if is_paper else paper_codes(self.reported_types, self.host)

    def tracker_sensors(self, commands: Sequence[CommandRecord] = ()) -> tuple[Sensor, ...]:
        """Return the sensors as trackers know them: with the confusion matrices, over
        `REPORTED_TYPES`, by which the classifier reports, and the spans in which they look at their
        whole field of regard after `commands`.
        """
        sensors = stated_sensors(self.sensors, commands, self.end_ns / 1e9)
        return sensors_of_trackers(sensors, self.scene.classification, self.host)

    def look_geometry(self) -> LookGeometry:
        """Return the geometry of the plan's looks."""
        return LookGeometry(
            states=SensorStates.of(self.sensors, self.bias),
            targets=self.targets,
            pairs=self.pairs,
            sightlines=self.sightlines,
            light_time=self.scene.light_time,
            exclusions=self.exclusions,
        )

    def sensor_names(self) -> list[str]:
        """Return the names of the sensors' scan streams: the ids, with the generation if scans were
        renumbered.
        """
        generations = self.scan_generations or (0,) * len(self.sensors)
        rows = zip(self.sensors, generations, strict=True)
        return [
            f"{sensor.id}@{generation}" if generation else sensor.id for sensor, generation in rows
        ]

    def pair_names(self) -> list[tuple[str, str]]:
        """Return the sensor's and the target's id of each pair."""
        return self._names_of_pairs([sensor.id for sensor in self.sensors])

    def scan_names(self) -> list[tuple[str, str]]:
        """Return the stream names of each pair's scans: as `pair_names`, with the names of
        `sensor_names`.
        """
        return self._names_of_pairs(self.sensor_names())

    def _names_of_pairs(self, sensors: Sequence[str]) -> list[tuple[str, str]]:
        rows = zip(self.pairs.sensor.tolist(), self.pairs.target.tolist(), strict=True)
        return [(sensors[sensor], self.targets.ids[target]) for sensor, target in rows]


def compile_plan(scene: Scene, host: Host | None = None) -> Plan:
    """Return the plan of a scene, with components from `host` (by default, all that are installed).

    Raises `PluginError` for components that are missing or broken, `SceneError` for targets without
    a trajectory and for more work than `scene.limits` accept, `TypeError` for an argument other
    than a scene.
    """
    given: Any = scene
    if not isinstance(given, Scene):
        need = "load_scene reads one from a file, scene_from_mapping from a dict"
        raise TypeError(f"a scene is needed, not {kind_of(given)}: {need}")
    host = host or Host.discover()
    with PluginErrors(host, scene):
        scene_parts = plan_parts(scene, host)
        exclusions = scene_parts.solar_exclusions()
        pairs, sightlines = scene_parts.pair_compiler(exclusions).compiled()
    plan = Plan(
        **asdict(scene_parts, recurse=False),
        pairs=pairs,
        sightlines=sightlines,
        exclusions=exclusions,
    )
    plan.workload.require_run()
    return plan


def reseeded(plan: Plan, seed: int) -> Plan:
    """Return the plan of the same scene with another seed: `compile_plan` of that scene, without
    what no seed changes.

    Sensors, launches and the tracker stay; so do the models, unless the scene has sources or the
    detection model `uses_seed`. Raises as `compile_plan`.
    """
    scene = evolve(plan.scene, seed=seed)
    host = plan.host
    if scene.fails_at_random:
        return compile_plan(scene, host)
    changed = evolve(plan, scene=scene, bias=drawn_bias(seed, plan.sensors))
    with PluginErrors(host, scene):
        if scene.sources or plan.detection.uses_seed:
            changed = evolve(changed, **_seeded_parts(plan, scene))
        if scene.sources:
            pairs, sightlines = changed.pair_compiler(plan.exclusions).compiled()
        else:
            pairs = changed.pair_compiler(plan.exclusions).rephased(plan.pairs)
            sightlines = plan.sightlines
    changed = evolve(changed, pairs=pairs, sightlines=sightlines)
    changed.workload.require_run()
    return changed


def _seeded_parts(plan: Plan, scene: Scene) -> dict[str, Any]:
    """Return the parts of a plan that depend on the seed, built for another one: sources and what
    follows from them.
    """
    host = plan.host
    sensors = plan.sensors
    places = _rows_by_model(scene)
    launches = plan.targets.trajectories[: len(places)]
    sources = _sources(scene, host, sensors, launches)
    targets = _joined(scene, launches, places, sources)
    detection, classifier, confidence = models_of(scene, host, sensors, targets, sources)
    make_tracker = partial(_tracker, scene, host, _tracker_context(scene, host, sensors, detection))
    models = {"detection": detection, "classifier": classifier, "confidence": confidence}
    return {**models, "sources": sources, "targets": targets, "make_tracker": make_tracker}


def plan_parts(scene: Scene, host: Host) -> PlanParts:
    """Build the components of a scene: sensors, sources, targets, models of detection, tracker.

    Raises `SceneError` with the problems of all sensors, sources and targets.
    """
    problems = BuildProblems()
    faults = faults_of(scene)
    built_sensors = list[Sensor]()
    for choice in scene.sensors:
        with problems.of(choice.model.path):
            context = SensorContext(
                id=choice.id,
                epoch_us=scene.epoch_us,
                readers=host.readers,
                duration_s=scene.duration_s,
            )
            sensor = _sensor(host, choice.model, context)
            built_sensors.append(watching(sensor, scene, faults))
    sensors = tuple(built_sensors)
    if faults is not None:
        with problems.of("faults"):
            faults.require_scans(scene, sensors)
    launches = _launches(scene, host, sensors, problems)
    sources = tuple["Sources", ...]()
    with problems.of("sources"):
        sources = _sources(scene, host, sensors, launches)
    problems.require_none()
    sensors, links = linked(scene, sensors)
    targets = _joined(scene, launches, _rows_by_model(scene), sources)
    detection, classifier, confidence = models_of(scene, host, sensors, targets, sources)
    make_tracker = partial(_tracker, scene, host, _tracker_context(scene, host, sensors, detection))
    # A tracker that cannot be built is an error of the plan, not of its first run.
    make_tracker()
    return PlanParts(
        scene=scene,
        host=host,
        sensors=sensors,
        targets=targets,
        detection=detection,
        classifier=classifier,
        confidence=confidence,
        make_tracker=make_tracker,
        bias=drawn_bias(scene.seed, sensors),
        end_ns=round(scene.duration_s * 1e9),
        make_director=director_maker_of(scene, host, sensors),
        faults=faults,
        links=links,
        sources=sources,
        reported_types=reported_types(scene, host),
    )


def with_targets(plan: Plan, targets: Targets, pairs: Pairs, sightlines: Sightlines) -> Plan:
    """Return a plan with other targets: its models are built for them, its sensors and its tracker
    stay the same.
    """
    with PluginErrors(plan.host, plan.scene):
        arguments = plan.scene, plan.host, plan.sensors, targets, plan.sources
        detection, classifier, confidence = models_of(*arguments, plan.classifier)
    changed = evolve(plan, detection=detection, classifier=classifier, confidence=confidence)
    return evolve(changed, targets=targets, pairs=pairs, sightlines=sightlines)


def whole_flights(plan: Plan) -> Targets:
    """Return the launches of a plan's scene with positions known up to impact, whichever sensors
    there are.

    Other hot sources are left out, and so are targets that a live run added.
    """
    scene = plan.scene
    rows = _rows_by_model(plan.scene)
    trajectories = [_trajectories(scene, plan.host, places, True) for places in rows]
    return join_targets([target.id for target in scene.targets], trajectories, rows)


def _sensor(host: Host, choice: Choice, context: SensorContext) -> Sensor:
    """Return a sensor; raises `ModelError` if what its component builds is none, or has values out
    of range.
    """
    sensor: Sensor = built(host, choice, context)
    hint = check_hint(choice.name)
    fault = blamed_call(
        lambda: owner_text(host, choice), hint, "orbit or scan", lambda: sensor_fault(sensor)
    )
    if fault:
        raise ModelError(f"{owner_text(host, choice)}: build made {fault}; {hint}")
    return sensor


def models_of(
    scene: Scene,
    host: Host,
    sensors: tuple[Sensor, ...],
    targets: Targets,
    sources: "tuple[Sources, ...]",
    former: Classifier | None = None,
) -> tuple[DetectionProbability, Classifier, Confidence]:
    """Return the models of detection, classification and confidence; a `former` classifier stays if
    it knows no truth.

    The densities of a classifier may take a second to compute.
    """
    context = ModelContext(
        sensors=sensors,
        target_type_code=targets.type_code,
        class_names=targets.class_names,
        target_class=partial(host.component, TargetClass),
        reported_types=reported_types(scene, host),
        hypotheses=offered_hypotheses(host),
        surroundings=Surroundings(scene, host, sensors, targets, sources),
    )
    detection = DetectionProbability.adopt(
        built(host, scene.detection, context), _owner(host, scene.detection)
    )
    context = evolve(context, detection=detection)
    if former is None or former.uses_truth:
        former = Classifier.adopt(
            built(host, scene.classification, context), _owner(host, scene.classification)
        )
    classifier = former
    context = evolve(context, classifier=classifier)
    confidence = Confidence.adopt(
        built(host, scene.confidence, context), _owner(host, scene.confidence)
    )
    return detection, classifier, confidence


def _tracker_context(
    scene: Scene, host: Host, sensors: tuple[Sensor, ...], detection: DetectionProbability
) -> TrackerContext:
    """Return the context of a scene's trackers."""
    rates = detection.rate_per_scan
    rules = detection.confirmation
    stated = stated_sensors(sensors, (), scene.duration_s)
    return TrackerContext(
        sensors=sensors_of_trackers(stated, scene.classification, host),
        epoch_us=scene.epoch_us,
        duration_s=scene.duration_s,
        forces=_forces(scene),
        light_time=scene.light_time,
        hypotheses=offered_hypotheses(host),
        false_alarms_per_scan=(0.0,) * len(sensors) if rates is None else tuple(map(float, rates)),
        confirmation=None if rules is None else tuple(map(tuple, rules.tolist())),
        parts={key: _part_maker(host, choice) for key, choice in scene.tracker.parts.items()},
    )


def _part_maker(host: Host, choice: Choice) -> PartMaker:
    """Return what makes a chosen part of a tracker."""
    component = host.component(choice.hook, choice.name, choice.path)
    return PartMaker(owner=owner_text(host, choice), config=choice.config, build=component.build)


def _tracker(scene: Scene, host: Host, context: TrackerContext) -> Tracker:
    """Return a new tracker of a scene; raises `ModelError` if what its component builds is no
    tracker.
    """
    tracker: Tracker = built(host, scene.tracker, context)
    fault = tracker_fault(tracker)
    if fault:
        raise ModelError(
            f"{owner_text(host, scene.tracker)}: {fault}; {check_hint(scene.tracker.name)}"
        )
    return tracker


def drawn_bias(seed: int, sensors: Sequence[Sensor]) -> PointingBias | None:
    """Return the line-of-sight biases of sensors, or None if no sensor has one."""
    has_bias = any(sensor.line_of_sight_bias_sigma_rad for sensor in sensors)
    return PointingBias.drawn(seed, sensors) if has_bias else None


def _owner(host: Host, choice: Choice) -> Callable[[], str]:
    """Return the function that makes the beginning of messages about a component."""
    return partial(owner_text, host, choice)


def _sources(
    scene: Scene, host: Host, sensors: Sequence[Sensor], launches: Sequence[Trajectories]
) -> "tuple[Sources, ...]":
    """Build the sources, one for each block of `sources`; some may follow the scene's launches."""
    if not scene.sources:
        return ()
    from opir_core.planning.sources import make_sources

    flights = {
        scene.targets[number].id: (launched, row)
        for launched, numbers in zip(launches, _rows_by_model(scene), strict=False)
        for row, number in enumerate(numbers)
    }
    return make_sources(scene, host, sensors, flights)


def _launches(
    scene: Scene, host: Host, sensors: Sequence[Sensor], problems: BuildProblems
) -> Sequence[Trajectories]:
    """Return the scene's launches, each model's in one batch; none where there are problems."""
    trajectories = list[Trajectories]()
    free_flight = any(sensor.follows_bodies for sensor in sensors)
    places = _rows_by_model(scene)
    for rows in places:
        with problems.of("targets"):
            trajectories.append(_trajectories(scene, host, rows, free_flight))
    return trajectories if len(trajectories) == len(places) else ()


def _joined(
    scene: Scene,
    launches: Sequence[Trajectories],
    rows: Sequence[Sequence[int]],
    sources: "Sequence[Sources]",
) -> Targets:
    """Return the launches, given with their numbers in the scene, and the emitters of the sources
    after them.
    """
    ids = [target.id for target in scene.targets]
    trajectories = [*launches]
    places = [*rows]
    classes = {name for launched in launches for name in launched.class_names}
    for source, block in zip(sources, scene.sources, strict=True):
        taken = sorted(classes.intersection(source.trajectories.class_names))
        if taken:
            raise ModelError(
                f"{block.model.path}: {taken[0]} is a kind of source here and the class of a"
                " target: give the class another name"
            )
        places.append(range(len(ids), len(ids) + len(source.ids)))
        ids += source.ids
        trajectories.append(source.trajectories)
    return join_targets(ids, trajectories, places)


def _rows_by_model(scene: Scene) -> list[list[int]]:
    """Return the numbers of the scene's launches, one list for each target model."""
    rows: dict[str, list[int]] = {}
    for place, target in enumerate(scene.targets):
        rows.setdefault(target.model.name, []).append(place)
    return [*rows.values()]


def _trajectories(
    scene: Scene, host: Host, places: Sequence[int], free_flight: bool
) -> Trajectories:
    targets = [scene.targets[place] for place in places]
    context = TargetContext(
        ids=tuple(target.id for target in targets),
        paths=tuple(target.model.path for target in targets),
        forces=_forces(scene),
        epoch_us=scene.epoch_us,
        duration_s=scene.duration_s,
        free_flight=free_flight,
        measures_light=_measures_light(scene, host),
        target_class=partial(host.component, TargetClass),
        readers=host.readers,
    )
    configs = [target.model.config for target in targets]
    trajectories = built(host, targets[0].model, context, configs)
    owner = _owner(host, targets[0].model)
    hint = check_hint(targets[0].model.name)
    fault = trajectories_fault(trajectories, len(targets))
    if not fault:
        adopted = Trajectories.adopt(trajectories, owner)
        fault = blamed_call(
            owner, hint, "position_ecef_m", lambda: motion_fault(adopted, context.ids)
        )
    if fault:
        raise ModelError(f"{owner()}: build made trajectories with {fault}; {hint}")
    return adopted


def _measures_light(scene: Scene, host: Host) -> bool:
    """Return whether the scene's detection model computes the light of targets."""
    choice = scene.detection
    subjects = host.component(choice.hook, choice.name, choice.path).subjects_read(choice.config)
    return subjects is None or LIGHT in subjects


def _forces(scene: Scene) -> "ForceModel":
    """Return the forces in free flight; two-body motion imports nothing."""
    if scene.forces.is_kepler:
        return "kepler"
    from opir_core.flight.forces import Drag, ExponentialAtmosphere, Forces

    drag = scene.forces.drag
    zonal = scene.forces.zonal
    if drag is None:
        return Forces(zonal=zonal)
    air = drag.exponential
    if air is None:
        return Forces(zonal=zonal, drag=Drag(drag.ballistic_coefficient_kg_m2))
    atmosphere = ExponentialAtmosphere(air.density_kg_m3, air.scale_height_m, air.base_height_m)
    return Forces(zonal=zonal, drag=Drag(drag.ballistic_coefficient_kg_m2, atmosphere))
