"""What the package offers: metrics, executors and commands; heavy modules are imported when one of
them is used.
"""

from collections.abc import Iterable
from importlib import import_module
from typing import Any

from opir_core.plugin import ExecutorModel, MetricModel, deferred, hookimpl
from opir_studies.configs import (
    CustodyConfig,
    DetectionByTimeConfig,
    HandOverConfig,
    ImpactConfig,
    LinksConfig,
    MilestonesConfig,
    ProcessesConfig,
    WarningConfig,
)

_SUMMARIES = {
    "compare": "run a scene with several trackers, many times, and score them",
    "merge": "join the shards of a study that several machines made",
    "optimise": "find the best design under requirements, by evaluating a small part of all"
    " designs",
    "rerun": "make a study or a run again from its folder, and say whether the bytes are the same",
    "sweep": "run a scene over many settings and seeds, and print metrics with intervals",
    "tune": "choose the accuracy settings of a scene: least run time for wanted errors",
}


@hookimpl
def opir_metrics() -> Iterable[MetricModel]:
    """Yield the standard metrics."""
    yield MetricModel(
        name="latency",
        summary="time from ignition to the first detection and to its report; share of launches"
        " detected",
        build=deferred("opir_studies.metrics.detection_metrics.latency_metric"),
    )
    yield MetricModel(
        name="detection_by_time",
        summary="share of launches detected by given times: cumulative probability of detection",
        config=DetectionByTimeConfig,
        build=deferred("opir_studies.metrics.detection_metrics.detection_by_time_metric"),
    )
    yield MetricModel(
        name="false_events",
        summary="detections of no launch, and false alarms, per day",
        build=deferred("opir_studies.metrics.detection_metrics.false_events_metric"),
    )
    yield MetricModel(
        name="links",
        summary="time from looks to their reports, shares of late and lost reports",
        config=LinksConfig,
        build=deferred("opir_studies.metrics.link_metric.links_metric"),
    )
    yield from _track_metrics()
    yield from _direction_metrics()


def _track_metrics() -> Iterable[MetricModel]:
    yield MetricModel(
        name="tracks",
        summary="share of launches tracked, completeness, false tracks, time to the first track",
        build=deferred("opir_studies.metrics.track_metrics.tracks_metric"),
    )
    yield MetricModel(
        name="accuracy",
        summary="errors of tracked position and velocity, root mean square",
        build=deferred("opir_studies.metrics.track_metrics.accuracy_metric"),
    )
    yield MetricModel(
        name="launch_error",
        summary="errors of estimated launch points and times, root mean square",
        build=deferred("opir_studies.metrics.track_metrics.launch_error_metric"),
    )
    yield MetricModel(
        name="impact_region",
        summary="area, containment and availability of predicted impact regions, by phase and time",
        config=ImpactConfig,
        build=deferred("opir_studies.metrics.track_metrics.impact_region_metric"),
    )
    yield MetricModel(
        name="warning_time",
        summary="time from a warning that meets a requirement, and stays within it, to the impact;"
        " times to report,"
        " track, region and warning",
        config=WarningConfig,
        build=deferred("opir_studies.metrics.warning_metric.warning_time_metric"),
    )
    yield MetricModel(
        name="milestones",
        summary="time from ignition until impact region, launch point or P(missile) stay within each"
        " of some bounds; shares of launches and regions that hold the impact then",
        config=MilestonesConfig,
        build=deferred("opir_studies.metrics.warning_metric.milestones_metric"),
    )


def _direction_metrics() -> Iterable[MetricModel]:
    yield MetricModel(
        name="custody",
        summary="share of the time from ignition to impact in which a launch is tracked",
        config=CustodyConfig,
        build=deferred("opir_studies.metrics.direction_metrics.custody_metric"),
    )
    yield MetricModel(
        name="cue_delay",
        summary="time from the first track to the first detection by a narrow field; share of"
        " launches with one",
        build=deferred("opir_studies.metrics.direction_metrics.cue_delay_metric"),
    )
    yield MetricModel(
        name="hand_over_gap",
        summary="hand-overs of launches between narrow fields, and the time that none detects",
        config=HandOverConfig,
        build=deferred("opir_studies.metrics.direction_metrics.hand_over_gap_metric"),
    )
    yield MetricModel(
        name="looks_used",
        summary="shares of the looks of narrow fields that detect a launch, and of their time that"
        " they turn",
        build=deferred("opir_studies.metrics.direction_metrics.looks_used_metric"),
    )


@hookimpl
def opir_executors() -> Iterable[ExecutorModel]:
    """Yield the executors of one computer."""
    yield ExecutorModel(
        name="serial",
        summary="one run after another, in this process",
        build=deferred("opir_studies.executors.serial_executor"),
    )
    yield ExecutorModel(
        name="processes",
        summary="worker processes on this computer; a worker that dies is replaced",
        config=ProcessesConfig,
        build=deferred("opir_studies.executors.processes_executor"),
    )


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir sweep`, `opir merge`, `opir rerun`, `opir optimise`, `opir compare` and `opir tune`."""
    arguments = import_module("opir_studies.arguments")
    for name, summary in _SUMMARIES.items():
        parser = commands.add_parser(name, help=summary)
        getattr(arguments, f"{name}_arguments")(parser)
        parser.set_defaults(run=deferred(f"opir_studies.{name}_command.{name}"), group="study")
