"""What a scene may set of the trackers. Nothing heavy is imported here."""

from attrs import fields, frozen

from opir_core.scene.fields import flag, nested, number, text

ASSOCIATIONS = ("nearest", "joint")
MOTIONS = ("boost-coast", "boost", "coast")
BOOST_MODELS = ("thrust", "jerk")


def _needed_scans() -> int:
    scans: int = number(
        default=4, minimum=2, maximum=100, help="M: in so many different scans a new target has to be seen"
    )
    return scans


def _recent_scans() -> int:
    scans: int = number(default=8, minimum=2, maximum=1000, help="N: among so many of the last scans of a sensor")
    return scans


def _check_scans(needed: int, recent: int) -> None:
    if recent < needed:
        raise ValueError(f"recent_scans is {recent}, less than needed_scans, {needed}")


@frozen(kw_only=True)
class ThrustConfig:
    """What the boost model `thrust` takes for granted of a burning target."""

    tilt_deg: float = number(
        default=8.0,
        unit="deg",
        above=0.0,
        maximum=45.0,
        source="drawn from the class priors, nine boosts in ten stay below 13, and half of them below 3 to 9; notional",
        help="standard deviation of the angle between thrust and velocity, in each of two directions",
    )
    tilt_s: float = number(default=30.0, unit="s", above=0.0, maximum=1e4, help="after so long that angle is another")
    noise_m_s2: float = number(
        default=3.0,
        unit="m/s²/√s",
        minimum=0.0,
        maximum=1000.0,
        source="a stage a minute, at which the force jumps by 20 to 25 m/s²: that over the root of the time; notional",
        help="how fast the force along the velocity wanders",
    )
    force_sigma_m_s2: float = number(
        default=10.0,
        unit="m/s²",
        above=0.0,
        maximum=1000.0,
        help="how far the first specific force may be from 20 m/s² straight up",
    )
    growth_per_s: float = number(
        default=0.01, unit="1/s", minimum=-0.1, maximum=0.1, help="rate at which the specific force grows at first"
    )
    growth_sigma_per_s: float = number(
        default=0.01, unit="1/s", above=0.0, maximum=1.0, help="standard deviation of that rate"
    )
    growth_noise_per_s: float = number(
        default=0.002, unit="1/s/√s", minimum=0.0, maximum=1.0, help="how fast that rate wanders"
    )
    jerk_noise_m_s3: float = number(
        default=0.1,
        unit="m/s³/√s",
        minimum=0.0,
        maximum=1000.0,
        help="how fast the jerk wanders on a path that is followed back to its launch",
    )


@frozen(kw_only=True)
class StereoFilterConfig:
    """What a scene may set of the tracker `stereo-filter`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.01, maximum=60.0, help="time between two estimates of a track"
    )
    association: str = text(
        default="nearest",
        choices=ASSOCIATIONS,
        help="nearest: the likeliest one-to-one assignment of each scan; joint: all of them, each as probable as it is",
    )
    slice_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.001,
        maximum=10.0,
        help="looks of a slice are taken in together; never longer than the cadence",
    )
    settling: int = number(
        default=2, minimum=0, maximum=20, help="how often a slice's rays are assigned anew by the estimates they led to"
    )
    gate_sigma: float = number(
        default=4.5, minimum=1.0, maximum=20.0, help="how far from the expected direction a ray may be"
    )
    false_alarms_per_sr: float = number(
        default=100.0, unit="1/sr", above=0.0, maximum=1e9, help="expected false alarms a scan, by solid angle"
    )
    needed_scans: int = _needed_scans()
    recent_scans: int = _recent_scans()
    motion: str = text(
        default="boost-coast", choices=MOTIONS, help="modes a target may be in: boost, free flight, or either"
    )
    boost_model: str = text(
        default="thrust",
        choices=BOOST_MODELS,
        help="thrust: a force along the velocity but for a tilt, slowly growing; jerk: any force, with a steady jerk",
    )
    thrust: ThrustConfig = nested(default=ThrustConfig(), help="what the boost model thrust takes for granted")
    jerk_noise_m_s3: float = number(
        default=0.3,
        unit="m/s³/√s",
        minimum=0.0,
        maximum=1000.0,
        help="how fast the jerk wanders with the boost model jerk",
    )
    coast_noise_m_s: float = number(
        default=0.01, unit="m/s/√s", minimum=0.0, maximum=100.0, help="how fast the velocity of a free flight wanders"
    )
    boost_s: float = number(default=150.0, unit="s", above=0.0, maximum=10000.0, help="mean length of a boost")
    coast_s: float = number(
        default=1000.0, unit="s", above=0.0, maximum=1e6, help="mean time of free flight before a boost"
    )
    late_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=600.0,
        help="detections that arrive up to this late are taken in as if they had been in time",
    )
    silence_s: float = number(
        default=1800.0, unit="s", above=0.0, maximum=1e6, help="a track unseen for longer is dropped"
    )
    lost_sigma_m: float = number(
        default=300e3,
        unit="m",
        above=0.0,
        maximum=1e9,
        help="a track less certain than this is dropped once it is unseen for longer than chance explains",
    )

    @property
    def jerk_noise_back_m_s3(self) -> float:
        """Return how fast the jerk wanders on a path that is followed back to its launch."""
        return self.jerk_noise_m_s3 if self.boost_model == "jerk" else self.thrust.jerk_noise_m_s3

    def __attrs_post_init__(self) -> None:
        _check_scans(self.needed_scans, self.recent_scans)


class _Follows:
    """What trackers have in common whose tracks are followed by the stereo filter."""

    __slots__ = ()

    cadence_s: float
    association: str
    needed_scans: int
    recent_scans: int

    def __attrs_post_init__(self) -> None:
        _check_scans(self.needed_scans, self.recent_scans)

    def stereo_filter(self) -> StereoFilterConfig:
        """Return what is set of the filter that follows the tracks."""
        return StereoFilterConfig(
            cadence_s=self.cadence_s,
            association=self.association,
            needed_scans=self.needed_scans,
            recent_scans=self.recent_scans,
        )


@frozen(kw_only=True)
class KeplerArcConfig(_Follows):
    """What a scene may set of the tracker `kepler-arc`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.1, maximum=60.0, help="time between two estimates of a track"
    )
    association: str = text(
        default="nearest",
        choices=ASSOCIATIONS,
        help="as that of stereo-filter, which follows the tracks; an arc takes each ray whole, as the likeliest"
        " assignment has it",
    )
    needed_scans: int = _needed_scans()
    recent_scans: int = _recent_scans()
    memory_s: float | None = number(
        default=None,
        unit="s",
        minimum=1.0,
        maximum=1e6,
        help="a detection so much older counts 1/e of a new one; by default all count alike, as in the paper",
    )
    climb_m_s2: float = number(
        default=15.0,
        unit="m/s²",
        above=0.0,
        maximum=200.0,
        source="twice the height over the square of the time since ignition of the class profiles: 7.5 (ICBM_liquid) to"
        " 18 (ICBM_solid), 15 to 17 of the others; notional",
        help="the height of a target that one sensor alone sees is taken to be half this times the square of the time"
        " since launch",
    )
    sigma_0_m: float = number(
        default=300e3,
        unit="m",
        above=0.0,
        maximum=2e7,
        source='opir-simulator paper (2026), section 5.2: early in boost "hundreds of kilometers"',
        help="σ of the predicted impact, along each axis of the ground, before the first detection",
    )
    convergence: float = number(
        default=4.6,
        minimum=0.0,
        maximum=100.0,
        source='opir-simulator paper (2026), section 5.2: "by mid-boost, it converges to tens of kilometers": ln 100',
        help="k in σ = σ₀ exp(-k n/N), with n of N expected detections of the boost in",
    )


@frozen(kw_only=True)
class BoostPriorConfig:
    """What a tracker takes for granted of a class: medians, and sigmas of their logarithms, of the turn in degrees."""

    burn_s: float = number(unit="s", above=0.0, maximum=2000.0, help="burn time")
    burn_sigma: float = number(above=0.0, maximum=1.0, help="spread of the burn time")
    speed_m_s: float = number(unit="m/s", above=0.0, maximum=12000.0, help="burnout speed relative to the Earth")
    speed_sigma: float = number(above=0.0, maximum=1.0, help="spread of the burnout speed")
    speed_shape: float = number(above=0.0, maximum=10.0, help="k of a speed that grows like expm1(k t/T)")
    shape_sigma: float = number(above=0.0, maximum=1.0, help="spread of the speed shape")
    pitch_exponent: float = number(above=0.0, maximum=5.0, help="n of a flight path angle that goes like u^n")
    pitch_sigma: float = number(above=0.0, maximum=1.0, help="spread of the pitch exponent")
    pitch_start_share: float = number(above=0.0, maximum=0.3, help="pitch start over burn time")
    start_sigma: float = number(above=0.0, maximum=1.0, help="spread of the pitch start")
    turn_deg: float = number(unit="deg", above=0.0, maximum=90.0, help="burnout angle from the vertical")
    turn_sigma_deg: float = number(unit="deg", above=0.0, maximum=45.0, help="spread of the burnout angle")


def _prior(*values: float) -> BoostPriorConfig:
    return BoostPriorConfig(**dict(zip((field.name for field in fields(BoostPriorConfig)), values, strict=True)))


@frozen(kw_only=True)
class BoostPriorsConfig:
    """The priors of the classes, and of when a boost is seen first, whatever its class."""

    ICBM: BoostPriorConfig = nested(
        default=_prior(206.0, 0.2, 6800.0, 0.06, 1.8, 0.25, 0.525, 0.15, 0.048, 0.3, 64.0, 5.0), help="intercontinental"
    )
    IRBM: BoostPriorConfig = nested(
        default=_prior(118.0, 0.2, 4000.0, 0.25, 1.45, 0.2, 0.55, 0.15, 0.068, 0.3, 52.0, 6.0), help="intermediate"
    )
    SRBM: BoostPriorConfig = nested(
        default=_prior(65.0, 0.2, 1600.0, 0.3, 0.95, 0.2, 0.85, 0.15, 0.09, 0.3, 48.0, 6.0), help="short range"
    )
    hidden_s: float = number(
        default=15.0,
        unit="s",
        minimum=1.0,
        maximum=100.0,
        source="at 15 m/s² two in three come out by a height of 1.7 km, 95 % by 7 km; notional",
        help="how long clouds hide a boost at first: that times the size of a standard normal number",
    )


@frozen(kw_only=True)
class BoostProfileConfig(_Follows):
    """What a scene may set of the tracker `boost-profile`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.1, maximum=10.0, help="time between two estimates of a track"
    )
    association: str = text(
        default="nearest",
        choices=ASSOCIATIONS,
        help="as that of stereo-filter, which follows the tracks; a fit takes each ray whole, as the likeliest"
        " assignment has it",
    )
    needed_scans: int = _needed_scans()
    recent_scans: int = _recent_scans()
    largest_impact_km: float = number(
        default=1000.0,
        unit="km",
        above=0.0,
        maximum=20000.0,
        help="an impact whose 95 % ellipse has a longer semi-axis is not told",
    )
    impacts_in_burn: bool = flag(default=False, help="tell impacts in the burn, as if all flew as their class does")
    priors: BoostPriorsConfig = nested(default=BoostPriorsConfig(), help="what is taken for granted of each class")
