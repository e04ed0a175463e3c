"""Settings of the trackers. Nothing heavy is imported here."""

from attrs import fields, frozen

from opir_core.scene.fields import flag, nested, number, text

ASSOCIATIONS = ("nearest", "joint")
MOTIONS = ("boost-coast", "boost", "coast")
BOOST_MODELS = ("thrust", "jerk")


def _needed_scans() -> int:
    scans: int = number(default=4, minimum=2, maximum=100, help="M of M-of-N track initiation: scans with a detection")
    return scans


def _recent_scans() -> int:
    scans: int = number(default=8, minimum=2, maximum=1000, help="N of M-of-N track initiation: last scans of a sensor")
    return scans


def _check_scans(needed: int, recent: int) -> None:
    if recent < needed:
        raise ValueError(f"recent_scans is {recent}, less than needed_scans, {needed}")


@frozen(kw_only=True)
class ThrustConfig:
    """Priors and process noise of the boost model `thrust`."""

    tilt_deg: float = number(
        default=8.0,
        unit="deg",
        above=0.0,
        maximum=45.0,
        source="of boosts drawn from the class priors, 90 % stay below 13 and 50 % below 3 to 9; notional",
        help="standard deviation of the angle between thrust and velocity, in each of two directions",
    )
    tilt_s: float = number(
        default=30.0, unit="s", above=0.0, maximum=1e4, help="Gauss–Markov correlation time of that angle"
    )
    noise_m_s2: float = number(
        default=3.0,
        unit="m/s²/√s",
        minimum=0.0,
        maximum=1000.0,
        source="one stage per minute with a force step of 20 to 25 m/s², divided by the root of the time; notional",
        help="process-noise density of the specific force along the velocity",
    )
    force_sigma_m_s2: float = number(
        default=10.0,
        unit="m/s²",
        above=0.0,
        maximum=1000.0,
        help="prior standard deviation of the specific force about 20 m/s² upwards",
    )
    growth_per_s: float = number(
        default=0.01,
        unit="1/s",
        minimum=-0.1,
        maximum=0.1,
        help="prior mean of the relative growth rate of the specific force",
    )
    growth_sigma_per_s: float = number(
        default=0.01, unit="1/s", above=0.0, maximum=1.0, help="prior standard deviation of that rate"
    )
    growth_noise_per_s: float = number(
        default=0.002, unit="1/s/√s", minimum=0.0, maximum=1.0, help="process-noise density of that rate"
    )
    jerk_noise_m_s3: float = number(
        default=0.1,
        unit="m/s³/√s",
        minimum=0.0,
        maximum=1000.0,
        help="process-noise density of the jerk on a path followed back to its launch",
    )


@frozen(kw_only=True)
class StereoFilterConfig:
    """Settings of the tracker `stereo-filter`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.01, maximum=60.0, help="time between two estimates of a track"
    )
    association: str = text(
        default="nearest",
        choices=ASSOCIATIONS,
        help="nearest: likeliest one-to-one assignment of each scan (GNN); joint: all, by probability (JPDA)",
    )
    slice_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.001,
        maximum=10.0,
        help="length of a slice, whose looks update a track together; at most the cadence",
    )
    settling: int = number(
        default=2, minimum=0, maximum=20, help="maximum number of reassignments of a slice by the updated estimates"
    )
    gate_sigma: float = number(default=4.5, minimum=1.0, maximum=20.0, help="gate, in standard deviations")
    false_alarms_per_sr: float = number(
        default=100.0,
        unit="1/sr",
        above=0.0,
        maximum=1e9,
        help="clutter density: expected false alarms per scan and solid angle",
    )
    needed_scans: int = _needed_scans()
    recent_scans: int = _recent_scans()
    motion: str = text(
        default="boost-coast", choices=MOTIONS, help="motion modes: boost, coast (free flight), or both (IMM)"
    )
    boost_model: str = text(
        default="thrust",
        choices=BOOST_MODELS,
        help="thrust: slowly growing force along the velocity but for a tilt; jerk: any force of nearly constant jerk",
    )
    thrust: ThrustConfig = nested(default=ThrustConfig(), help="priors and process noise of the boost model thrust")
    jerk_noise_m_s3: float = number(
        default=0.3,
        unit="m/s³/√s",
        minimum=0.0,
        maximum=1000.0,
        help="process-noise density of the boost model jerk",
    )
    coast_noise_m_s: float = number(
        default=0.01, unit="m/s/√s", minimum=0.0, maximum=100.0, help="process-noise density of the coast mode"
    )
    boost_s: float = number(default=150.0, unit="s", above=0.0, maximum=10000.0, help="mean duration of a boost")
    coast_s: float = number(
        default=1000.0, unit="s", above=0.0, maximum=1e6, help="mean duration of a coast before another boost"
    )
    late_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=600.0,
        help="detections up to this late are processed in order of time",
    )
    regions_every_s: float = number(
        default=5.0,
        unit="s",
        minimum=0.1,
        maximum=600.0,
        help="impact regions are worked out anew after this time, and where a target stops or starts to burn",
    )
    silence_s: float = number(
        default=1800.0, unit="s", above=0.0, maximum=1e6, help="a track is deleted after this time without detection"
    )
    lost_sigma_m: float = number(
        default=300e3,
        unit="m",
        above=0.0,
        maximum=1e9,
        help="a track with a larger position sigma is deleted once missed detections no longer explain its silence",
    )

    @property
    def jerk_noise_back_m_s3(self) -> float:
        """Return the process-noise density of the jerk on a path followed back to its launch."""
        return self.jerk_noise_m_s3 if self.boost_model == "jerk" else self.thrust.jerk_noise_m_s3

    def __attrs_post_init__(self) -> None:
        _check_scans(self.needed_scans, self.recent_scans)


class _Follows:
    """Settings of trackers that use the tracks of the stereo filter."""

    __slots__ = ()

    cadence_s: float
    association: str
    needed_scans: int
    recent_scans: int

    def __attrs_post_init__(self) -> None:
        _check_scans(self.needed_scans, self.recent_scans)

    def stereo_filter(self) -> StereoFilterConfig:
        """Return the settings of the stereo filter."""
        return StereoFilterConfig(
            cadence_s=self.cadence_s,
            association=self.association,
            needed_scans=self.needed_scans,
            recent_scans=self.recent_scans,
        )


@frozen(kw_only=True)
class KeplerArcConfig(_Follows):
    """Settings of the tracker `kepler-arc`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.1, maximum=60.0, help="time between two estimates of a track"
    )
    association: str = text(
        default="nearest",
        choices=ASSOCIATIONS,
        help="data association of the stereo filter; the arc uses the likeliest assignment",
    )
    needed_scans: int = _needed_scans()
    recent_scans: int = _recent_scans()
    memory_s: float | None = number(
        default=None,
        unit="s",
        minimum=1.0,
        maximum=1e6,
        help="time constant of exponential forgetting; by default none, as in the paper",
    )
    climb_m_s2: float = number(
        default=15.0,
        unit="m/s²",
        above=0.0,
        maximum=200.0,
        source="twice the height over the squared time since ignition of the class profiles: 7.5 (ICBM_liquid) to"
        " 18 (ICBM_solid), 15 to 17 of the others; notional",
        help="assumed vertical acceleration of a target seen by one sensor: height = half this times the squared time"
        " since launch",
    )
    sigma_0_m: float = number(
        default=300e3,
        unit="m",
        above=0.0,
        maximum=2e7,
        source='opir-simulator paper (2026), section 5.2: early in boost "hundreds of kilometers"',
        help="σ₀ of the predicted impact, per ground axis, before the first detection",
    )
    convergence: float = number(
        default=4.6,
        minimum=0.0,
        maximum=100.0,
        source='opir-simulator paper (2026), section 5.2: "by mid-boost, it converges to tens of kilometers": ln 100',
        help="k in σ = σ₀ exp(-k n/N), after n of N expected detections of the boost",
    )


@frozen(kw_only=True)
class BoostPriorConfig:
    """Prior of a class: medians and sigmas of logarithms; the turn in degrees."""

    burn_s: float = number(unit="s", above=0.0, maximum=2000.0, help="burn time")
    burn_sigma: float = number(above=0.0, maximum=1.0, help="prior sigma of the burn time")
    speed_m_s: float = number(unit="m/s", above=0.0, maximum=12000.0, help="burnout speed relative to the Earth")
    speed_sigma: float = number(above=0.0, maximum=1.0, help="prior sigma of the burnout speed")
    speed_shape: float = number(above=0.0, maximum=10.0, help="k of a speed proportional to expm1(k t/T)")
    shape_sigma: float = number(above=0.0, maximum=1.0, help="prior sigma of the speed shape")
    pitch_exponent: float = number(above=0.0, maximum=5.0, help="n of a flight path angle proportional to u^n")
    pitch_sigma: float = number(above=0.0, maximum=1.0, help="prior sigma of the pitch exponent")
    pitch_start_share: float = number(above=0.0, maximum=0.3, help="pitch start as a share of the burn time")
    start_sigma: float = number(above=0.0, maximum=1.0, help="prior sigma of the pitch start")
    turn_deg: float = number(unit="deg", above=0.0, maximum=90.0, help="burnout angle from the vertical")
    turn_sigma_deg: float = number(unit="deg", above=0.0, maximum=45.0, help="prior sigma of the burnout angle")


def _prior(*values: float) -> BoostPriorConfig:
    return BoostPriorConfig(**dict(zip((field.name for field in fields(BoostPriorConfig)), values, strict=True)))


@frozen(kw_only=True)
class BoostPriorsConfig:
    """Priors of the classes, and of the first detection of a boost of any class."""

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
        source="at 15 m/s², 68 % emerge below 1.7 km and 95 % below 7 km; notional",
        help="scale of the half-normal time for which clouds hide a boost at first",
    )


@frozen(kw_only=True)
class BoostProfileConfig(_Follows):
    """Settings of the tracker `boost-profile`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.1, maximum=10.0, help="time between two estimates of a track"
    )
    association: str = text(
        default="nearest",
        choices=ASSOCIATIONS,
        help="data association of the stereo filter; the fit uses the likeliest assignment",
    )
    needed_scans: int = _needed_scans()
    recent_scans: int = _recent_scans()
    largest_impact_km: float = number(
        default=1000.0,
        unit="km",
        above=0.0,
        maximum=20000.0,
        help="an impact whose 95 % ellipse has a longer semi-axis is not reported",
    )
    impacts_in_burn: bool = flag(
        default=False, help="report predicted impact points before burnout, assuming the class profile"
    )
    priors: BoostPriorsConfig = nested(default=BoostPriorsConfig(), help="priors of the classes")
