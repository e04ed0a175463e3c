"""Settings of the tracker and the director `stonesoup`. Nothing heavy is imported here."""

from typing import Any

from attrs import frozen

from opir_core.plugin import number, part, text

FILTERS = ("ekf", "ukf")
ASSOCIATIONS = ("gnn", "jpda")
MANAGERS = ("brute-force", "greedy")
MOTIONS = ("acceleration", "jerk", "two-body")


@frozen
class StoneSoupConfig:
    """Settings of the tracker `stonesoup`."""

    cadence_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.01,
        maximum=60.0,
        help="time between two estimates of a track",
    )
    filter: str = text(
        default="ekf",
        choices=FILTERS,
        help="ekf: extended Kalman filter, Joseph form; ukf: unscented Kalman filter",
    )
    association: str = text(
        default="gnn",
        choices=ASSOCIATIONS,
        help="gnn: GNNWith2DAssignment, one to one; jpda: JPDAwithEHM2, all assignments weighted by"
        " probability",
    )
    motion: str = text(
        default="acceleration",
        choices=MOTIONS,
        help="gravity of the scene's forces and: acceleration, a nearly constant specific force;"
        " jerk, its nearly"
        " constant rate as well; two-body, nothing",
    )
    noise: float = number(
        default=2.0,
        unit="m/s²/√s, m/s³/√s or m/s/√s",
        minimum=0.0,
        maximum=1000.0,
        help="process-noise density of the last derivative of the motion: force, its rate, or"
        " velocity",
    )
    coast_noise: float = number(
        default=0.01,
        unit="m/s/√s",
        minimum=0.0,
        maximum=100.0,
        help="process-noise density of the free flight that a forecast expects of a target that no"
        " longer burns",
    )
    forecast: Any = part(
        role="forecast",
        default="regions",
        help="hypotheses and impact regions of launches, or none of them",
    )
    detection_probability: float = number(
        default=0.9,
        above=0.0,
        below=1.0,
        help="P_d, probability that a look at a track's target detects it",
    )
    gate_probability: float = number(
        default=0.9999,
        above=0.0,
        below=1.0,
        help="probability that a track's own detection passes its gate",
    )
    false_alarms_per_sr: float = number(
        default=100.0,
        unit="1/sr",
        above=0.0,
        maximum=1e9,
        help="clutter density: expected false alarms per look and solid angle",
    )
    needed_hits: int = number(
        default=4,
        minimum=1,
        maximum=100,
        help="number of detections that confirm a track; only confirmed tracks are reported",
    )
    tentative_s: float = number(
        default=30.0,
        unit="s",
        above=0.0,
        maximum=1e6,
        help="an unconfirmed track, or one above lost_sigma_m, is deleted after this time without"
        " detection",
    )
    silence_s: float = number(
        default=120.0,
        unit="s",
        above=0.0,
        maximum=1e6,
        help="a track is deleted after this time without detection",
    )
    lost_sigma_m: float = number(
        default=300e3,
        unit="m",
        above=0.0,
        maximum=1e9,
        help="a track with a larger position sigma is deleted after tentative_s without detection",
    )


@frozen
class StoneSoupDirectorConfig:
    """Settings of the director `stonesoup`."""

    interval_s: float = number(
        default=5.0, unit="s", minimum=0.01, maximum=3600.0, help="time between decisions"
    )
    manager: str = text(
        default="brute-force",
        choices=MANAGERS,
        help="brute-force: BruteForceSensorManager, the best of all plans; greedy:"
        " GreedySensorManager, the best track of each sensor as if it were alone",
    )
    most_plans: int = number(
        default=256,
        minimum=1,
        maximum=1_000_000,
        help="of more plans (each sensor has a track of those in its reach) the greedy manager"
        " chooses",
    )
    noise: float = number(
        default=10.0,
        unit="m/s/√s",
        minimum=0.0,
        maximum=1000.0,
        help="process-noise density of the velocity between a track's last tick and the next"
        " decision",
    )
    least_probability_launch: float = number(
        default=0.5,
        minimum=0.0,
        maximum=1.0,
        help="tracks with a smaller probability of a launch get no sensor; those whose tracker does"
        " not weigh it do",
    )
