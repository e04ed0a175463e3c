"""One run of a study: the tasks of workers, and their results."""

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from attrs import define, evolve, frozen

from opir_core import Plan, Scene, __version__, compile_plan, reseeded, run_of_plan
from opir_core.host import described_error
from opir_core.plugin import Host, Metric
from opir_core.random_streams import SCHEME
from opir_core.reading import scene_hash
from opir_core.simulation import components_used
from opir_studies.launches import launch_columns


@frozen
class RunTask:
    """Runs of one design: replicate k has the scene's seed plus k, whatever the design."""

    scene: Scene
    replicates: tuple[int, ...]
    metrics: tuple[Metric, ...]


@frozen
class RunRecord:
    """A finished run: the values of the figures in the order of the metrics, or the reason of its
    failure.

    `launches` are the columns of its launches, in the order of `launch_units`.
    """

    replicate: int
    seed: int
    run_time_s: float
    values: tuple[float, ...] = ()
    failure: str = ""
    launches: tuple[tuple[Any, ...], ...] = ()


@frozen
class TaskResult:
    """The records of a task's runs, and the versions of what made them: opir-core, NumPy and the
    plugins used.
    """

    versions: Mapping[str, str]
    records: tuple[RunRecord, ...]


@define(eq=False)
class ReplicatePlans:
    """Plans of the replicates of designs, one design after another: parts that no seed changes are
    built once.
    """

    _scene: Scene | None = None
    _plan: Plan | None = None

    def of(self, scene: Scene, seed: int) -> Plan:
        """Return the plan of a design's scene with a seed; raises as `compile_plan`."""
        if self._plan is None or (self._scene is not scene and self._scene != scene):
            self._scene = scene
            self._plan = compile_plan(evolve(scene, seed=seed), worker_host())
            return self._plan
        return reseeded(self._plan, seed)


#: Those of this process: a task is one of many of its design.
PLANS = ReplicatePlans()


def result_of(task: RunTask) -> TaskResult:
    """Return the records of a task: the function that executors run."""
    records = tuple(_record(task, number) for number in task.replicates)
    plugins = {
        plugin.distribution: plugin.version
        for plugin in worker_host().used()
        if plugin.distribution
    }
    return TaskResult({"opir-core": __version__, "numpy": np.__version__, **plugins}, records)


def installed_version(name: str) -> str:
    """Return the version of a distribution in this process, "none" if it has none."""
    versions = {"opir-core": __version__, "numpy": np.__version__}
    with suppress(PackageNotFoundError):
        return versions.get(name) or version(name)
    return "none"


def _record(task: RunTask, replicate: int) -> RunRecord:
    seed = task.scene.seed + replicate
    start = time.perf_counter()
    try:
        run = run_of_plan(PLANS.of(task.scene, seed))
        values = tuple(
            float(value)
            for metric in task.metrics
            for value in _in_order(metric, metric.values(run))
        )
        launches = launch_columns(run, task.metrics)
    except Exception as error:  # of any plugin: the other runs go on, and the study reports it
        return RunRecord(
            replicate, seed, time.perf_counter() - start, failure=described_error(error)
        )
    return RunRecord(replicate, seed, time.perf_counter() - start, values, launches=launches)


def _in_order(metric: Metric, values: Mapping[str, float]) -> Sequence[float]:
    if values.keys() != metric.units.keys():
        raise ValueError(
            f"the metric gives {', '.join(values)}, where its figures are {', '.join(metric.units)}"
        )
    return [values[name] for name in metric.units]


@cache
def worker_host() -> Host:
    """Return the installed plugins, found once per process."""
    return Host.discover()


def identity_of(
    plan: Plan, metrics: Sequence[tuple[str, Mapping[str, Any], str, Sequence[str]]]
) -> str:
    """Return the SHA-256 of all that the runs of a design depend on, except their number.

    These are the scene, the files that it reads, opir-core, the plugins of its components, and the
    metrics: name, settings, owner and figures of each.
    """
    files = run_files(plan)
    contents = [
        scene_hash(plan.scene),
        files,
        SCHEME,
        __version__,
        owners_of(plan),
        [list(metric) for metric in metrics],
    ]
    return hashlib.sha256(json.dumps(contents, sort_keys=True, default=str).encode()).hexdigest()


def owners_of(plan: Plan) -> tuple[tuple[str, str], ...]:
    """Return the distributions of a plan's components with their versions, sorted."""
    components = components_used(plan)
    return tuple(sorted({(each["distribution"], each["version"]) for each in components}))


def run_files(plan: Plan) -> list[Any]:
    """Return the files that a plan's trajectories were read from, with their hashes, as in the
    manifest.
    """
    return [file for trajectory in plan.targets.trajectories for file in trajectory.files]


def run_key(identity: str, replicate: int) -> str:
    """Return the key of a run, 40 hexadecimal digits."""
    return hashlib.sha256(f"{identity}:{replicate}".encode()).hexdigest()[:40]
