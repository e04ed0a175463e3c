"""A study made ready to run: every design's scene compiled once, metrics built, keys known."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import asdict, evolve, field, frozen

from opir_core import Plan, Scene, compile_plan
from opir_core.arrays import FloatArray
from opir_core.errors import PluginError, Problem, SceneError
from opir_core.plugin import (
    ExecutorContext,
    ExecutorModel,
    Host,
    Metric,
    MetricContext,
    MetricModel,
)
from opir_core.reading import (
    ComponentReader,
    InvalidNode,
    Settings,
    block_of,
    load_scene,
    node_of_data,
    ordered,
    scene_from_mapping,
)
from opir_core.scene import Choice
from opir_studies.axes import Design, Level, designs_of, override_text
from opir_studies.launches import BASE_UNITS, FACTS, launch_facts, launch_units
from opir_studies.refusals import cut_short, refusal
from opir_studies.requirements import FigureRequirement, require_figures, requirements_of
from opir_studies.runs import identity_of, installed_version, owners_of, run_key
from opir_studies.share_requirements import (
    ShareRequirement,
    missing_milestones,
    require_columns,
    require_conditions,
    share_requirements_of,
)
from opir_studies.statistics import share_with_value
from opir_studies.study import Study
from opir_studies.subsets import parted, with_subset
from opir_studies.until import DECIDED, Until, until_of

#: The most problems that one message lists, and notes of a study.
_MOST_PROBLEMS = 20
_MOST_NOTES = 3
#: Metrics whose figures change when a burnout is recognised, and how long after it a scene should
#: last, s: the phases of `impact_region` end 20 s after it.
_OF_WHOLE_BURNS = {"impact_region", "warning_time", "milestones"}
#: Metrics that have no figures, or the worst, without a tracker.
_OF_TRACKS = {
    *_OF_WHOLE_BURNS,
    "accuracy",
    "cue_delay",
    "custody",
    "launch_error",
    "search_volume",
    "tracks",
}
AFTER_BURNOUT_S = 30.0
#: The metric of bounds of quantities over time.
MILESTONES = "milestones"


@frozen
class PlannedDesign:
    """A design with its scene, and the identity of its runs."""

    design: Design
    scene: Scene
    identity: str
    #: Id, class and site of each launch.
    launches: tuple[tuple[str, str, str], ...] = ()
    #: The distributions of the components of its scene, with their versions.
    owners: tuple[tuple[str, str], ...] = ()

    def key(self, replicate: int) -> str:
        """Return the key of a run of the design."""
        return run_key(self.identity, replicate)


@frozen
class PlannedStudy:
    """A study whose designs compile and whose metrics exist."""

    study: Study
    designs: tuple[PlannedDesign, ...]
    names: tuple[str, ...]
    metrics: tuple[Metric, ...]
    until: Until | None
    requirements: tuple[FigureRequirement, ...] = ()
    share_requirements: tuple[ShareRequirement, ...] = ()
    #: What a reader must know of the scenes, in sentences.
    notes: tuple[str, ...] = ()
    #: The settings of each metric, by its name.
    settings: Mapping[str, Any] = field(factory=dict)
    #: The versions of all that makes the results, by distribution.
    versions: Mapping[str, str] = field(factory=dict)

    @property
    def units(self) -> Mapping[str, str]:
        """Return the unit of each figure, by name."""
        return {name: unit for metric in self.metrics for name, unit in metric.units.items()}

    @property
    def shares(self) -> Mapping[str, str]:
        """Return, for each figure that launches may lack, the figure that is the share of those
        that have it.
        """
        return {
            name: share
            for metric in self.metrics
            for name, share in getattr(metric, "shares", {}).items()
        }

    @property
    def launch_units(self) -> Mapping[str, str]:
        """Return the columns of launches with their units, by name."""
        return launch_units(self.metrics)

    @property
    def containments(self) -> Mapping[str, float]:
        """Return the stated containment of each column that says whether a launch's region held."""
        return {
            name: nominal
            for metric in self.metrics
            for name, nominal in getattr(metric, "launch_containments", {}).items()
        }

    @property
    def groups(self) -> list[list[int]]:
        """Return the numbers of the designs that differ in their conditions alone, by what
        varies.
        """
        groups: dict[tuple[Level, ...], list[int]] = {}
        chosen = len(self.study.vary)
        for number, planned in enumerate(self.designs):
            groups.setdefault(planned.design.levels[:chosen], []).append(number)
        return list(groups.values())

    def share_of(self, values: Mapping[str, FloatArray], figure: str) -> float:
        """Return the share of launches, or else runs, that have a figure; `values` (runs,) of the
        figures.
        """
        share = self.shares.get(figure)
        return share_with_value(values[figure], None if share is None else values[share])


def planned_study(
    study: Study, host: Host | None = None, designs: Sequence[Design] | None = None
) -> PlannedStudy:
    """Return a study made ready to run; `designs` are some instead of all of them.

    Raises `SceneError` with the problems of all designs, each with the design and the place in its
    scene, or `PluginError` for a component that is missing.
    """
    host = host or Host.discover()
    source = f"study {study.study}"
    _require_split(study)
    shares = share_requirements_of(study.requirements, source)
    require_conditions(shares, study.conditions, source)
    choices, metrics = _metrics(study, shares, host)
    require_columns(shares, launch_units(metrics), source)
    if study.until == DECIDED and not shares:
        words = f"{DECIDED} needs a requirement on a share of launches, and the study has none"
        raise refusal("until", words, source)
    settings = [asdict(choice.config) for choice in choices]
    metric_identities = [
        (
            choice.name,
            config,
            _owner(choice, host),
            [*metric.units, *getattr(metric, "launch_units", {})],
        )
        for choice, config, metric in zip(choices, settings, metrics, strict=True)
    ]
    ready, end_notes = _ready_designs(study, host, designs, metric_identities, shares)
    figures = {name: unit for metric in metrics for name, unit in metric.units.items()}
    names = _numbered([choice.name for choice in choices])
    require_figures(study.show, "show", figures, source)
    requirements = requirements_of(study.requirements, figures, source)
    template = "{} more designs have scenes that end too early"
    detection_notes = _detection_notes([design.scene for design in ready])
    return PlannedStudy(
        study,
        ready,
        names,
        metrics,
        until_of(study, figures),
        requirements,
        shares,
        (
            *detection_notes,
            *_partial_notes(requirements, metrics),
            *cut_short(end_notes, _MOST_NOTES, template),
        ),
        dict(zip(names, settings, strict=True)),
        _versions(ready, choices, host),
    )


def _metrics(
    study: Study, shares: Sequence[ShareRequirement], host: Host
) -> tuple[list[Choice], tuple[Metric, ...]]:
    """Return the metrics of a study, and `milestones` with the bounds that requirements on shares
    need besides; raises `SceneError`.
    """
    choices = [
        _choice(MetricModel.hook, metric, f"metrics[{row}]", host)
        for row, metric in enumerate(study.metrics)
    ]
    metrics = [_built_metric(choice, host) for choice in choices]
    bounds = missing_milestones(shares, launch_units(metrics))
    if bounds is not None:
        choices.append(_choice(MetricModel.hook, {MILESTONES: bounds}, "requirements", host))
        metrics.append(_built_metric(choices[-1], host))
    _require_distinct(metrics, f"study {study.study}")
    return choices, tuple(metrics)


def _versions(
    designs: Sequence[PlannedDesign], metrics: Sequence[Choice], host: Host
) -> dict[str, str]:
    """Return the versions of opir-core, NumPy and the plugins of scenes and metrics."""
    owners = {
        host.provenance(choice.hook, choice.name).distribution: host.provenance(
            choice.hook, choice.name
        ).version
        for choice in metrics
    }
    owners |= {name: version for design in designs for name, version in design.owners}
    names = dict.fromkeys(["opir-core", "numpy", "opir-studies"])
    return dict(sorted({**{name: installed_version(name) for name in names}, **owners}.items()))


def _partial_notes(
    requirements: Sequence[FigureRequirement], metrics: Sequence[Metric]
) -> Iterator[str]:
    """Yield a note on each required mean of a figure that launches may lack."""
    shares = {
        name: share for metric in metrics for name, share in getattr(metric, "shares", {}).items()
    }
    for required in requirements:
        if required.figure in shares:
            yield (
                f"{required} is on a mean over the launches that have it, which a design meets only"
                f" if all have it; require a share of launches instead, such as 'detected within 30"
                " s in 90 % of launches'"
            )


def _ready_designs(
    study: Study,
    host: Host,
    designs: Sequence[Design] | None,
    metrics: Sequence[tuple[str, Mapping[str, Any], str, Sequence[str]]],
    shares: Sequence[ShareRequirement],
) -> tuple[tuple[PlannedDesign, ...], list[str]]:
    """Return the compiled designs, and notes on scenes without a tracker or that end too early.

    Raises `SceneError` with the problems of all designs.
    """
    ready = list[PlannedDesign]()
    problems = list[Problem]()
    notes = dict[str, None]()
    names = {name for name, *_ in metrics}
    for design in designs_of(study) if designs is None else designs:
        try:
            plan = _compiled(study, design, host)
        except SceneError as error:
            problems += [Problem(design.name, str(problem)) for problem in error.problems]
            continue
        identity = identity_of(plan, metrics)
        facts = launch_facts(plan)
        ready.append(PlannedDesign(design, plan.scene, identity, facts, owners_of(plan)))
        notes |= dict.fromkeys(_late_notes(plan, shares))
        if names & _OF_TRACKS and plan.scene.tracker.name == "none":
            notes["the scene has no tracker, which its metrics need: set tracker=imm"] = None
        elif names & _OF_WHOLE_BURNS:
            notes[_end_note(plan)] = None
    if problems:
        more = len(problems) - _MOST_PROBLEMS
        more_problems = [Problem("", f"and {more} more")] if more > 0 else []
        raise SceneError(
            [*problems[:_MOST_PROBLEMS], *more_problems],
            source=f"study {study.study}, scene {_name(study)}",
        )
    return tuple(ready), list(filter(None, notes))


def _detection_notes(scenes: Sequence[Scene]) -> Iterator[str]:
    """Yield which detection model `auto` chose, and a warning where designs have different ones."""
    lines = dict.fromkeys(line for scene in scenes for line in scene.automatic)
    models = dict.fromkeys(scene.detection.name for scene in scenes)
    if lines and len(models) > 1:
        yield (
            f"designs differ in their detection model, {' and '.join(models)}, besides what is"
            " varied: name one for all, --set detection=NAME"
        )
    elif lines:
        yield next(iter(lines))


def _late_notes(plan: Plan, shares: Sequence[ShareRequirement]) -> Iterator[str]:
    """Yield a note on each required share of launches by a time after the end of the scene."""
    launches = len(plan.scene.targets)
    if not launches:
        return
    target = int(np.argmax(plan.targets.ignition_s[:launches]))
    after_s = plan.scene.duration_s - float(plan.targets.ignition_s[target])
    for required in shares:
        if required.is_by_time and after_s < required.limit < math.inf:
            yield (
                f"the scene ends {after_s:g} s after the ignition of {plan.targets.ids[target]}:"
                f" '{required}' counts what comes later as never; let the scene last"
                f" {required.limit - after_s:g} s longer"
            )


def _end_note(plan: Plan) -> str:
    """Return a note on the end of a scene that is too early for metrics of predicted impacts, or
    "".
    """
    launches = len(plan.scene.targets)
    if not launches:
        return ""
    target = int(np.argmax(plan.targets.burnout_s[:launches]))
    after_s = plan.scene.duration_s - float(plan.targets.burnout_s[target])
    if after_s >= AFTER_BURNOUT_S:
        return ""
    side = "before" if after_s < 0.0 else "after"
    return (
        f"the scene ends at {plan.scene.duration_s:g} s, {abs(after_s):.0f} s {side} the burnout of"
        f" {plan.targets.ids[target]}: impact regions shrink when a burnout is recognised; let it"
        f" last {AFTER_BURNOUT_S:.0f} s longer than the burn"
    )


def built_executor(study: Study, context: ExecutorContext, host: Host | None = None) -> Any:
    """Return the executor of a study; raises `SceneError` or `PluginError` as `planned_study`
    does.
    """
    host = host or Host.discover()
    choice = _choice(ExecutorModel.hook, study.executor, "executor", host)
    return host.component(ExecutorModel, choice.name).build(choice.config, context)


def _compiled(study: Study, design: Design, host: Host) -> Plan:
    fixed = [f"{path}={override_text(value)}" for path, value in study.overrides.items()]
    overrides, subset = parted([*fixed, *design.overrides])
    if isinstance(study.scene, Mapping):
        scene = scene_from_mapping(study.scene, overrides=overrides, host=host)
    else:
        scene = load_scene(study.scene, overrides=overrides, host=host)
    return compile_plan(evolve(with_subset(scene, subset), outputs=()), host)


def _numbered(names: Sequence[str]) -> tuple[str, ...]:
    """Return names with a number where one is repeated, as a metric with other settings is."""
    return tuple(
        name if name not in names[:place] else f"{name}_{names[:place].count(name) + 1}"
        for place, name in enumerate(names)
    )


def _name(study: Study) -> str:
    is_block = isinstance(study.scene, Mapping)
    return str(study.scene.get("scene", "") if is_block else study.scene)


def _choice(hook: str, written: Any, path: str, host: Host) -> Choice:
    """Return the component that a study names: a name, or a block {name: settings}."""
    reader = ComponentReader(host)
    source = "study"
    name = written
    settings = None
    if isinstance(written, Mapping) and len(written) == 1:
        ((name, settings),) = written.items()
    if not isinstance(name, str) or not name:
        raise refusal(path, "write a name, or {name: settings}", source)
    node = node_of_data(settings or {})
    try:
        return reader.choice(
            hook, name, path, Settings(node, dict(block_of(node)), other_keys=("preset",))
        )
    except InvalidNode as refused:
        problems = [
            Problem(f"{path}.{name}{'.' if complaint.path else ''}{complaint.path}", complaint.text)
            for complaint in ordered(refused.complaints)
        ]
        if problems:
            raise SceneError(problems, source=source) from None
        raise PluginError("\n".join(map(str, reader.failures))) from None


def _owner(choice: Choice, host: Host) -> str:
    owner = host.provenance(choice.hook, choice.name)
    return f"{owner.distribution} {owner.version}"


def _built_metric(choice: Choice, host: Host) -> Metric:
    return host.component(MetricModel, choice.name).build(choice.config, MetricContext())


def _require_split(study: Study) -> None:
    paths = [*study.vary, *study.conditions]
    if study.split and study.split not in paths:
        words = f"{study.split!r} does not vary; {', '.join(paths) or 'nothing'} does"
        raise refusal("split", words, f"study {study.study}")


def _require_distinct(metrics: Sequence[Metric], source: str) -> None:
    names = [name for metric in metrics for name in metric.units]
    columns = [name for metric in metrics for name in getattr(metric, "launch_units", {})]
    names_of_launches = [*FACTS, *BASE_UNITS, *columns]
    twice = sorted({name for name in names if names.count(name) > 1})
    reserved = sorted(set(names) & {"key", "replicate", "seed", "run_time_s", "design"})
    words = [
        *(f"two metrics give {name}" for name in twice),
        *(
            f"two metrics give launches {name}"
            for name in dict.fromkeys(columns)
            if names_of_launches.count(name) > 1
        ),
        *(f"{name} is reserved" for name in reserved),
        *([] if names else ["name one at least"]),
    ]
    if words:
        raise refusal("metrics", words[0], source)
