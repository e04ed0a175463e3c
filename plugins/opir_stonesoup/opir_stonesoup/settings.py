"""What a scene may set of the tracker `stonesoup`. Nothing heavy is imported here."""

from attrs import frozen

from opir_core.scene.fields import number, text

FILTERS = ("ekf", "ukf")
ASSOCIATIONS = ("gnn", "jpda")
MOTIONS = ("acceleration", "jerk", "two-body")


@frozen(kw_only=True)
class StoneSoupConfig:
    """What a scene may set of the tracker `stonesoup`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.01, maximum=60.0, help="time between two estimates of a track"
    )
    filter: str = text(
        default="ekf", choices=FILTERS, help="ekf: extended Kalman filter, Joseph form; ukf: unscented Kalman filter"
    )
    association: str = text(
        default="gnn",
        choices=ASSOCIATIONS,
        help="gnn: GNNWith2DAssignment, one to one; jpda: JPDAwithEHM2, all assignments, each as probable as it is",
    )
    motion: str = text(
        default="acceleration",
        choices=MOTIONS,
        help="gravity of the scene's forces and: acceleration, a nearly constant specific force; jerk, its nearly"
        " constant rate as well; two-body, nothing",
    )
    noise: float = number(
        default=2.0,
        unit="m/s²/√s, m/s³/√s or m/s/√s",
        minimum=0.0,
        maximum=1000.0,
        help="how fast the last derivative of the motion wanders: of the force, of its rate, or of the velocity",
    )
    detection_probability: float = number(
        default=0.9, above=0.0, below=1.0, help="chance that a look at a track's target detects it"
    )
    gate_probability: float = number(
        default=0.9999, above=0.0, below=1.0, help="chance that a track's own detection passes its gate"
    )
    false_alarms_per_sr: float = number(
        default=100.0, unit="1/sr", above=0.0, maximum=1e9, help="expected false alarms a look, by solid angle"
    )
    needed_hits: int = number(
        default=4, minimum=1, maximum=100, help="a track is told of once so many detections were its own"
    )
    tentative_s: float = number(
        default=30.0,
        unit="s",
        above=0.0,
        maximum=1e6,
        help="a track not yet told of, or less certain than lost_sigma_m, is dropped if unseen for longer",
    )
    silence_s: float = number(
        default=120.0, unit="s", above=0.0, maximum=1e6, help="a track unseen for longer is dropped"
    )
    lost_sigma_m: float = number(
        default=300e3,
        unit="m",
        above=0.0,
        maximum=1e9,
        help="a track less certain than this is dropped once it is unseen for tentative_s",
    )
