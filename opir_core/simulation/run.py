"""A whole run in memory, with its summary and manifest; and the windows of a plan.

Windows are sized by their numbers of looks and of expected false alarms, so that memory grows
neither with a scene's duration nor with a sensor's rate of false alarms.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np
from attrs import field, frozen

from opir_core.arrays import IntArray
from opir_core.errors import Problem, SceneError, number_of
from opir_core.host.host import Host
from opir_core.interfaces.records import CommandRecord, Detections, DetectionTruth, Tracks, Window
from opir_core.interfaces.sensors import Sensor
from opir_core.notebook import progress as shown_progress
from opir_core.planning.plan import Plan, compile_plan, reseeded
from opir_core.planning.sightlines import Pairs
from opir_core.scene.scene import REPORTED_TYPES, Scene
from opir_core.simulation.engine import Engine
from opir_core.simulation.manifest import run_manifest
from opir_core.simulation.observation import joined_detections
from opir_core.simulation.report_order import ReportOrder
from opir_core.simulation.summary import Tally


@frozen(eq=False, repr=False)
class Run:
    """A finished run: its columns, its plan, its summary and its manifest.

    `detections` and `truth` have a row per detection, `tracks` a row per track and tick,
    `estimates` those to which `detections.estimate` refers.
    """

    detections: Detections
    truth: DetectionTruth
    tracks: Tracks
    estimates: Tracks
    sensors: Sequence[Sensor]
    target_ids: Sequence[str]
    #: Of each target the times, sensors and latencies of its detections: the rows of
    #: `summary["targets"]` without types, which cost most, and tracks.
    sightings: Sequence[Mapping[str, Any]]
    #: Returns the summary.
    make_summary: Callable[[Detections, DetectionTruth], Mapping[str, Any]]
    #: Returns the manifest.
    make_manifest: Callable[[], Mapping[str, Any]]
    #: The names of the detections' reported types, by code.
    reported_types: Sequence[str] = REPORTED_TYPES
    plan: Plan = field(kw_only=True)
    #: What became of the director's commands.
    commands: Sequence[CommandRecord] = ()
    #: Reports (sensors,) that did not arrive; None without links.
    lost: IntArray | None = None

    @cached_property
    def summary(self) -> Mapping[str, Any]:
        """The summary, with the types of detections; made when it is first read."""
        return self.make_summary(self.detections, self.truth)

    @cached_property
    def manifest(self) -> Mapping[str, Any]:
        """The manifest, made when it is first read."""
        return self.make_manifest()

    def __repr__(self) -> str:
        """Return the scene with the counts, in one line."""
        scene = self.plan.scene
        tracks = len(np.unique(self.tracks.track))
        return (
            f"<Run of {scene.name}: {number_of('detection', len(self.detections))}"
            f" of {number_of('target', len(self.sightings))} by"
            f" {number_of('sensor', len(self.sensors))},"
            f" {number_of('track', tracks)}, {scene.duration_s:g} s, seed {scene.seed}>"
        )

    def _repr_html_(self) -> str:
        """Return a table of the targets for a notebook, with the run view `map` if it is
        installed.
        """
        return str(_views().run_html(self))

    def view(self, name: str, wanted: str = "") -> Any:
        """Return the view of a name, which a plugin offers (hook `opir_run_views`): the run in
        another form.

        Raises `PluginError` if it is not installed; `wanted` begins the message, by default
        `run.view('NAME')`.
        """
        return _views().run_view(self, name, wanted or f"run.view({name!r})")

    @property
    def plot(self) -> Any:
        """Return the plots of the run, `run.plot.map()` for instance; with opir-report."""
        return self.view("plot", "run.plot")

    def save(self, path: str | Path = "events.jsonl") -> Path:
        """Write events, truth, tracks and manifest as `opir run` does; return the events' path.

        `opir.load_run` reads them back. Events are columns where the path ends in `.parquet`, with
        opir-export. Raises `SinkError` where a file cannot be written.
        """
        return cast("Path", self.view("save", "run.save()")(path))

    def report(self, path: str | Path = "report.html") -> Path:
        """Write the report of the run, one HTML file, with opir-report; return its path."""
        return cast("Path", self.view("report", "run.report()")(path))

    def score(self, **settings: Any) -> Any:
        """Return the scores of the tracks against the truth, with opir-scoring.

        `settings` are those of `opir_scoring.ScoreSettings`, such as `bin_s`.
        """
        return self.view("score", "run.score()")(**settings)

    def tables(self) -> Mapping[str, Any]:
        """Return the run as Arrow tables by name, with opir-export."""
        return cast("Mapping[str, Any]", self.view("tables", "run.tables()"))

    def to_pandas(self) -> Mapping[str, Any]:
        """Return the tables as data frames of pandas by name, with opir-export."""
        return cast("Mapping[str, Any]", self.view("pandas", "run.to_pandas()"))

    def to_polars(self) -> Mapping[str, Any]:
        """Return the tables as data frames of polars by name, with opir-export."""
        return cast("Mapping[str, Any]", self.view("polars", "run.to_polars()"))


def _views() -> Any:
    """Return the module of views, which a run by the command line does not need."""
    return import_module("opir_core.simulation.run_views")


#: Steps of a progress bar.
PROGRESS_STEPS = 50
#: Target number of looks per window, events in looks of the same memory; a column of them takes
#: 2 MiB.
LOOKS_PER_WINDOW = 1 << 18


def window_edges_ns(plan: Plan, window_s: float | None = None, workers: int = 1) -> Sequence[int]:
    """Return the ends of a plan's windows, ns: every `window_s`, or after about `LOOKS_PER_WINDOW`
    looks and false alarms.

    With several workers, after as many looks in all of their windows together.
    """
    if window_s is None:
        looks = max(LOOKS_PER_WINDOW // max(workers, 1), 1)
        return _edges_by_looks(plan.pairs, plan.workload.false_looks_per_s(), plan.end_ns, looks)
    step_ns = round(window_s * 1e9)
    if step_ns < 1:
        raise SceneError(
            [Problem("window_s", f"{window_s!r} is not a positive time of at least a nanosecond")]
        )
    return [*range(step_ns, plan.end_ns, step_ns), plan.end_ns]


def _edges_by_looks(
    pairs: Pairs, false_looks_per_s: float, end_ns: int, looks: int
) -> Sequence[int]:
    """Return the ends of windows of as many looks, of pairs and of false alarms."""
    looking = pairs.take(pairs.looks > 0)
    total = int(looking.looks.sum()) + int(false_looks_per_s * end_ns * 1e-9)
    if total <= looks:
        return [end_ns]
    starts = looking.phase_ns + looking.first_scan * looking.period_ns
    stops = looking.phase_ns + (looking.last_scan + 1) * looking.period_ns
    times_ns = np.unique(np.concatenate([starts, stops, [0, end_ns]]))
    # The approximate number of looks before each time: the sum of the pairs' rates between start
    # and stop.
    rates = np.zeros(len(times_ns))
    np.add.at(rates, np.searchsorted(times_ns, starts), 1.0 / looking.period_ns)
    np.add.at(rates, np.searchsorted(times_ns, stops), -1.0 / looking.period_ns)
    rates = np.cumsum(rates) + false_looks_per_s * 1e-9
    passed = np.concatenate([[0.0], np.cumsum(rates[:-1] * np.diff(times_ns))])
    look_counts = np.arange(looks, total, looks)
    edges = np.unique(np.rint(np.interp(look_counts, passed, times_ns)).astype(np.int64))
    return [*(edge for edge in edges.tolist() if 0 < edge < end_ns), end_ns]


def simulate(
    scene: Scene,
    host: Host | None = None,
    *,
    window_s: float | None = None,
    workers: int = 1,
    progress: bool = False,
) -> Run:
    """Return the run of a scene: all detections and tracks as columns in memory.

    `window_s` sets the length of the windows, `workers` the number of processes that compute them,
    `progress` shows a bar, in a notebook's cell or on standard error; none of them changes a
    result. For scenes too large for memory use `opir_core.windows`.
    """
    return run_of_plan(compile_plan(scene, host), window_s, workers=workers, progress=progress)


def replicates(scene: Scene, runs: int, host: Host | None = None) -> Iterator[Run]:
    """Yield runs of a scene, run k with the scene's seed plus k: each is that of `simulate`, byte
    for byte.

    What no seed changes is built once: trajectories, sensors, models.

    >>> import opir_core as opir
    >>> scene = opir.load_scene("examples/first_light.yaml")
    >>> [len(run.detections) for run in opir.replicates(scene, 3)]
    [750, 742, 733]
    """
    plan = compile_plan(scene, host)
    for number in range(runs):
        yield run_of_plan(reseeded(plan, scene.seed + number) if number else plan)


def run_of_plan(
    plan: Plan, window_s: float | None = None, *, workers: int = 1, progress: bool = False
) -> Run:
    """Return the run of a plan; each call returns the same run. The options are those of
    `simulate`.
    """
    tally = Tally(plan)
    windows = list[Window]()
    duration_s = plan.end_ns * 1e-9
    if progress and window_s is None:
        window_s = duration_s / PROGRESS_STEPS
    with shown_progress(is_shown=progress) as update:
        for window in plan_windows(plan, window_s, workers=workers):
            tally.count_sightings(window)
            windows.append(window)
            update(f"{plan.scene.name}, s", min(window.end_s, duration_s), duration_s)
    return _collected(plan, tally, windows)


def windows(
    scene: Scene, host: Host | None = None, *, window_s: float | None = None, workers: int = 1
) -> Iterator[Window]:
    """Yield the windows of a scene, in order of time; `window_s` and `workers` are as in
    `simulate`.
    """
    yield from plan_windows(compile_plan(scene, host), window_s, workers=workers)


def plan_windows(
    plan: Plan, window_s: float | None = None, *, workers: int = 1
) -> Iterator[Window]:
    """Yield the windows of a plan, in order of time; the last one has what is reported after the
    scene's end.

    `window_s` and `workers` are as in `simulate`.
    """
    if workers != 1 and plan.has_independent_windows:
        from opir_core.simulation.shared_run import (
            shared_windows,
        )  # a run in one process does not load it

        edges_ns = window_edges_ns(plan, window_s, workers)
        yield from (window for window, _ in shared_windows(plan, edges_ns, workers))
        return
    engine = Engine(plan)
    reports = ReportOrder(plan)
    for edge_ns in window_edges_ns(plan, window_s):
        yield reports.take(engine.advance(edge_ns), edge_ns)
    last_window = reports.rest()
    if last_window is not None:
        yield last_window


def _collected(plan: Plan, tally: Tally, windows: Sequence[Window]) -> Run:
    return Run(
        detections=joined_detections(windows).freeze(),
        truth=DetectionTruth.concatenate(window.truth for window in windows),
        tracks=Tracks.concatenate(window.tracks for window in windows),
        estimates=Tracks.concatenate(window.estimates for window in windows),
        commands=[record for window in windows for record in window.commands],
        lost=tally.lost,
        sensors=plan.sensors,
        target_ids=plan.targets.ids,
        sightings=tally.sightings(),
        make_summary=tally.summary_with_types,
        make_manifest=partial(run_manifest, plan, tally.counts(), tally.steering.commands),
        reported_types=plan.reported_types,
        plan=plan,
    )
