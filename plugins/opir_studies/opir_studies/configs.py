"""Settings of metrics and executors; nothing heavy is imported here."""

from typing import Any

from attrs import frozen

from opir_core.scene.fields import nested, number


@frozen(kw_only=True)
class ProcessesConfig:
    """The settings of the executor `processes`."""

    workers: int | None = number(
        help="number of worker processes; --workers takes precedence",
        default=None,
        minimum=1,
        maximum=4096,
        source="as many as there are cores",
    )


def _times_complaint(times: Any) -> str | None:
    if not times or list(times) != sorted(set(times)):
        return "the times must increase, and one at least is needed"
    return None


@frozen(kw_only=True)
class DetectionByTimeConfig:
    """The settings of the metric `detection_by_time`."""

    times_s: tuple[float, ...] = nested(
        help="times since ignition",
        default=(2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0),
        unit="s",
        minimum=0.0,
        check=_times_complaint,
        source="arbitrary",
    )
