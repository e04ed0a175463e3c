"""Settings of metrics and executors; nothing heavy is imported here."""

from typing import Any

from attrs import frozen

from opir_core.plugin import nested, number


@frozen
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


@frozen
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


@frozen
class CustodyConfig:
    """The settings of the metric `custody`."""

    within_km: float | None = number(
        help="an estimate counts whose position is within this of the truth; null for any",
        default=10.0,
        unit="km",
        above=0.0,
        source="notional",
    )


@frozen
class HandOverConfig:
    """The settings of the metric `hand_over_gap`."""

    lost_after_s: float = number(
        help="a field that has not detected a launch for so long has lost it",
        default=5.0,
        unit="s",
        above=0.0,
        source="notional",
    )


@frozen
class LinksConfig:
    """The settings of the metric `links`."""

    late_s: float = number(
        help="time after its look from which a report is late",
        default=30.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        source="notional",
    )


#: Phases of a flight at which predicted impacts are scored, as in `opir_scoring`.
PHASE_NAMES = (
    "25 % of burn",
    "50 % of burn",
    "75 % of burn",
    "95 % of burn",
    "5 s after burnout",
    "20 s after burnout",
    "last estimate",
)
_CONTAINMENTS_PERCENT = (50.0, 90.0, 95.0)


def _phases_complaint(phases: Any) -> str | None:
    unknown = [phase for phase in phases if phase not in PHASE_NAMES]
    if unknown or len(set(phases)) < len(phases):
        return (
            f"{unknown[0]!r} is no phase; there are {', '.join(PHASE_NAMES)}"
            if unknown
            else "a phase is repeated"
        )
    return None


def _moments_complaint(times: Any) -> str | None:
    return None if list(times) == sorted(set(times)) else "the times must increase"


def _containment_percent(of: str) -> Any:
    """Return the field of the containment of a tracker's reports; `_require_containment` checks
    it.
    """
    words = f"containment of {of}: 50, 90 or 95"
    return number(
        help=words, default=95.0, unit="%", minimum=50.0, maximum=95.0, source="convention"
    )


def _require_containment(percent: float) -> None:
    if percent not in _CONTAINMENTS_PERCENT:
        raise ValueError(f"containment_percent: {percent:g} is not 50, 90 or 95")


@frozen
class ImpactConfig:
    """The settings of the metric `impact_region`."""

    containment_percent: float = _containment_percent("the regions")
    phases: tuple[str, ...] = nested(
        help="phases of the flight",
        default=("last estimate", "5 s after burnout", "75 % of burn"),
        check=_phases_complaint,
        source="arbitrary",
    )
    times_s: tuple[float, ...] = nested(
        help="times since ignition; an estimate counts for 5 s",
        default=(),
        unit="s",
        minimum=0.0,
        check=_moments_complaint,
        source="arbitrary",
    )

    def __attrs_post_init__(self) -> None:
        _require_containment(self.containment_percent)
        if not self.phases and not self.times_s:
            raise ValueError("give phases or times_s")


@frozen
class WarningConfig:
    """The settings of the metric `warning_time`: requirements on a warning; null for not
    required.
    """

    missile_probability: float | None = number(
        help="P(missile) of the track is above this",
        default=0.9,
        minimum=0.0,
        maximum=1.0,
        source="notional",
    )
    region_km2: float | None = number(
        help="the reported impact region is smaller than this",
        default=1e6,
        unit="km2",
        above=0.0,
        source="notional",
    )
    launch_point_km: float | None = number(
        help="the semi-major axis of the reported launch point's ellipse is less than this",
        default=10.0,
        unit="km",
        above=0.0,
        source="notional",
    )
    containment_percent: float = _containment_percent("region and ellipse")

    def __attrs_post_init__(self) -> None:
        _require_containment(self.containment_percent)


#: Quantities of a track that have bounds, and whether each is to be above its bound.
QUANTITIES: dict[str, bool] = {
    "region_km2": False,
    "launch_point_km": False,
    "missile_probability": True,
}


def milestone_name(quantity: str, bound: float) -> str:
    """Return the name of a quantity within a bound, `region_km2_below_1000`."""
    words = f"{bound:g}".replace("+", "").replace("-", "m").replace(".", "_")
    return f"{quantity}_{'above' if QUANTITIES[quantity] else 'below'}_{words}"


def _bounds_complaint(bounds: Any) -> str | None:
    if 0.0 in bounds:
        return "a bound of 0 is never met; give one above 0"
    return "a bound is repeated" if len(set(bounds)) < len(bounds) else None


def _bounds(what: str, unit: str, default: tuple[float, ...], largest: float) -> Any:
    return nested(
        help=f"bounds of {what}",
        default=default,
        unit=unit,
        minimum=0.0,
        maximum=largest,
        check=_bounds_complaint,
        source="notional",
    )


@frozen
class MilestonesConfig:
    """The settings of the metric `milestones`: bounds, each reached when all later estimates of a
    launch are within it too.
    """

    region_km2: tuple[float, ...] = _bounds(
        "the reported impact region", "km2", (1e6, 1e5, 1e4, 1e3), 6e8
    )
    launch_point_km: tuple[float, ...] = _bounds(
        "the semi-major axis of the reported launch point's ellipse", "km", (), 2.1e4
    )
    missile_probability: tuple[float, ...] = _bounds("P(missile)", "", (), 1.0)
    containment_percent: float = _containment_percent("region and ellipse")

    def __attrs_post_init__(self) -> None:
        _require_containment(self.containment_percent)
        if not any(getattr(self, quantity) for quantity in QUANTITIES):
            raise ValueError("give a bound of region_km2, launch_point_km or missile_probability")
