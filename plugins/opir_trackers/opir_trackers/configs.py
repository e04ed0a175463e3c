"""Settings of the trackers. Nothing heavy is imported here."""

from collections.abc import Mapping
from typing import Any

from attrs import asdict, fields_dict, frozen

from opir_core.errors import nearest
from opir_core.plugin import nested, number, part, text
from opir_core.scene import QuadrangleConfig, info_of

#: Default gate, standard deviations: two axes exceed it with a probability of 4 · 10⁻⁵.
GATE_SIGMAS = 4.5

MODES = ("boost-coast", "boost", "coast")

#: States of a motion model: position, velocity, specific force, and its relative growth.
MOTION_STATES = 10

_COASTS = ("unless modes: boost", lambda config: config.modes != "boost")
_SWITCHES = ("with modes: boost-coast", lambda config: config.modes == "boost-coast")


def _needed_scans() -> int | None:
    return number(
        default=None,
        minimum=2,
        maximum=100,
        help="M of M-of-N track initiation: scans with a detection; by default 4, or 2 where 4"
        " scans take over 4 s",
    )


def _recent_scans() -> int:
    return number(
        default=8,
        minimum=2,
        maximum=1000,
        help="N of M-of-N track initiation: last scans of a sensor",
    )


def _check_scans(needed: int | None, recent: int) -> None:
    if needed is not None and recent < needed:
        raise ValueError(f"recent_scans is {recent}, less than needed_scans, {needed}")


@frozen
class ThrustConfig:
    """Priors and process noise of a boost."""

    tilt_deg: float = number(
        default=3.0,
        unit="deg",
        above=0.0,
        maximum=45.0,
        source="steering of the tracker's law of boosts beyond 1 km/s: 2.4"
        " (docs/design/pitch_over.py), with shorter"
        " correlation; with 2 velocities of flights unlike that law were held too seldom; notional",
        help="standard deviation of the angle between thrust and velocity, in each of two"
        " directions, once a boost has"
        " pitched over",
    )
    tilt_s: float = number(
        default=30.0,
        unit="s",
        above=0.0,
        maximum=1e4,
        help="Gauss–Markov correlation time of that angle",
    )
    noise_m_s2: float = number(
        default=0.5,
        unit="m/s²/√s",
        minimum=0.0,
        maximum=1000.0,
        source="half of the force's growth of 1 % a second, at 50 m/s², for 4 s; notional",
        help="process-noise density of the specific force along the velocity within a stage",
    )
    stage_s: float = number(
        default=40.0,
        unit="s",
        above=0.0,
        maximum=1e4,
        source="least burn of a boost of the tracker's prior; tuned on 24 two-stage flights: the"
        " state's 95 % region"
        " holds 92 % of the states at the staging mark, with 60 or 90 s 83 %; 80 s was not tried;"
        " notional",
        help="mean time from one stage to the next; a new stage begins with the prior of force and"
        " growth",
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
        default=0.01,
        unit="1/s",
        above=0.0,
        maximum=1.0,
        help="prior standard deviation of that rate",
    )
    growth_noise_per_s: float = number(
        default=0.001,
        unit="1/s/√s",
        minimum=0.0,
        maximum=1.0,
        help="process-noise density of that rate",
    )
    free_share: float = number(
        default=0.1,
        minimum=0.0,
        maximum=0.5,
        source="notional: one burn in ten after the dark, or after looks that no boost explains",
        help="probability that a burn after the dark has a force in any direction (a stage that"
        " flies back)",
    )
    free_sigma_m_s2: float = number(
        default=22.0,
        unit="m/s²",
        above=0.0,
        maximum=1000.0,
        source="each axis as large as the force of a new stage, 20 ± 10 m/s²: root mean square 22;"
        " notional",
        help="prior standard deviation of a force in any direction, on each axis",
    )
    free_noise_m_s2: float = number(
        default=2.5,
        unit="m/s²/√s",
        above=0.0,
        maximum=1000.0,
        source="a force of 40 m/s² that loses a third in 30 s as engines are shut down one by one;"
        " notional",
        help="process-noise density of a force in any direction, on each axis",
    )
    free_s: float = number(
        default=300.0,
        unit="s",
        above=0.0,
        maximum=1e4,
        source="several times a burn of 30 to 60 s that flies back: it keeps its direction;"
        " notional",
        help="mean time until a force in any direction is one along the velocity again",
    )
    residual_share: float = number(
        default=0.05,
        minimum=0.0,
        maximum=1.0,
        source="a plume of SNR 100 is detected down to a twentieth of its intensity; notional",
        help="standard deviation of the unseen force for 5 s after burnout, as a share of the force"
        " before",
    )
    launch_noise_m_s2: float = number(
        default=0.25,
        unit="m/s²/√s",
        minimum=0.0,
        maximum=1000.0,
        source="a cubic through the true motion of 150 flights of the tracker's prior, followed"
        " back to the launch"
        " over 20 to 80 s, misses the velocity as 0.14 to 0.4 would; notional",
        help="process-noise density of the force on a path followed back to its launch",
    )


@frozen
class AreaConfig(QuadrangleConfig):
    """Rates within a part of the Earth between two parallels and two meridians; it may cross the
    date line.
    """

    start_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=1e9,
        help="since when the rates hold, in the scene",
    )
    end_s: float = number(
        default=1e9,
        unit="s",
        above=0.0,
        maximum=1e9,
        help="until when they hold",
    )
    rates: Mapping[str, float] = nested(
        unit="1/day",
        help="rates within the area by their names, such as flashes_per_day",
    )

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        if self.start_s >= self.end_s:
            raise ValueError(f"end_s {self.end_s:g} is not after start_s {self.start_s:g}")
        if not self.rates:
            raise ValueError("rates: give one at least, such as {flashes_per_day: 100}")

    def overlaps(self, other: "AreaConfig") -> bool:
        """Return whether it has a place and a time in common with another area."""
        gaps_deg = (
            (other.west_deg - self.west_deg) % 360.0,
            (self.west_deg - other.west_deg) % 360.0,
        )
        is_beside = gaps_deg[0] >= self.width_deg and gaps_deg[1] >= other.width_deg
        return not (
            is_beside
            or min(self.north_deg, other.north_deg) <= max(self.south_deg, other.south_deg)
            or min(self.end_s, other.end_s) <= max(self.start_s, other.start_s)
        )


@frozen
class HypothesesConfig:
    """Prior rates and densities of what a track may be."""

    launches_per_day: float = number(
        default=1.0,
        unit="1/day",
        above=0.0,
        maximum=1e6,
        source="one launch for each thousand hot sources on the ground; some 250 launches to orbit"
        " a year alone;"
        " notional",
        help="prior rate of launches in view: anything powered that rises",
    )
    ground_sources_per_day: float = number(
        default=1000.0,
        unit="1/day",
        minimum=0.0,
        maximum=1e9,
        source="MODIS Collection 6 lists 40 196 fire pixels on one day on Earth (30 September"
        " 2020), in clusters;"
        " notional",
        help="prior rate of hot sources that appear on the ground in view: fires, flares, glints,"
        " industry",
    )
    bolides_per_day: float = number(
        default=0.1,
        unit="1/day",
        minimum=0.0,
        maximum=1e6,
        source="CNEOS fireballs: 35.8 a year on Earth",
        help="prior rate of bolides in view",
    )
    flashes_per_day: float = number(
        default=7.5,
        unit="1/day",
        minimum=0.0,
        maximum=1e6,
        source="of 44 lightning flashes a second on Earth (Christian et al., J. Geophys. Res."
        " 108(D1), 4005, 2003) those bright for long enough to be tracked: superbolts above 1 MJ"
        " are 2.5 a day (Holzworth et al., J. Geophys. Res. Atmos. 124, 9996, 2019: 8171 in nine"
        " years); three times as many: notional",
        help="prior rate of flashes of lightning in view that last for half a second in the mean;"
        " more where storms are in view",
    )
    aircraft_per_day: float = number(
        default=2.2,
        unit="1/day",
        minimum=0.0,
        maximum=1e6,
        source="of some 1e5 flights a day (ICAO) those on afterburner that no cloud hides: notional",
        help="prior rate of aircraft in view that are hot enough to be tracked in flight: level,"
        " climbing, turning; more where air bases are in view",
    )
    take_offs_per_day: float = number(
        default=0.001,
        unit="1/day",
        minimum=0.0,
        maximum=1e6,
        source="notional: no air base in view",
        help="prior rate of take-offs on afterburner in view; more where air bases are in view: then"
        " one sensor alone does not tell them from launches that rise slowly",
    )
    reentries_per_day: float = number(
        default=0.5,
        unit="1/day",
        minimum=0.0,
        maximum=1e6,
        source="1 to 3 catalogued bodies re-enter a day, 1200 intact ones in 2024 (ESA, Space"
        " Environment Report, 2025), a third of them in view",
        help="prior rate of bodies in view that enter the air from an orbit",
    )
    others_per_day: float = number(
        default=0.15,
        unit="1/day",
        above=0.0,
        maximum=1e6,
        source="notional: one for seven launches",
        help="prior rate of objects in view that are none of these: ships, vehicles, balloons, what"
        " nobody thought of",
    )
    in_flight_share: float = number(
        default=0.15,
        minimum=0.0,
        maximum=1.0,
        help="share of launches that are first seen in flight: out of cloud, or when a sensor"
        " begins to look",
    )
    air_share: float = number(
        default=0.01,
        minimum=0.0,
        maximum=1.0,
        help="share of the other launches that begin in the air, at a height and a speed; where"
        " they are expected, more",
    )
    inland_share: float = number(
        default=0.5,
        minimum=0.0,
        maximum=1.0,
        source="the Earth's land is 0.8 km high in the mean, with a standard deviation of 0.8 km"
        " (ETOPO1); notional",
        help="share of launch sites, and of sources that stand or move on the ground, that are as"
        " high as land is; the"
        " others are at sea level: ships, coasts, lowlands",
    )
    ground_drift_m_s: float = number(
        default=1.0,
        unit="m/s",
        above=0.0,
        maximum=100.0,
        source="a wind-driven fire front advances by some 1 m/s; a pointing bias of 20 µrad from a"
        " low orbit"
        " moves a source by less",
        help="standard deviation of the apparent velocity of a source on the ground, per axis",
    )
    bolide_s: float = number(
        default=5.0,
        unit="s",
        above=0.0,
        maximum=1000.0,
        help="mean time for which a bolide is bright",
    )
    areas: tuple[AreaConfig, ...] = nested(
        default=(),
        help="areas with rates of their own for what is first seen within them; rates that an area"
        " does not name are as dense there as in all of the view",
    )

    def __attrs_post_init__(self) -> None:
        names = self.rates()
        for place, area in enumerate(self.areas):
            for name, per_day in area.rates.items():
                if name not in names:
                    raise ValueError(
                        f"areas[{place}].rates: {name!r} is no rate{nearest(name, names)}; rates"
                        f" are {', '.join(names)}"
                    )
                info = info_of(fields_dict(HypothesesConfig)[name])
                if not info.accepts(per_day):
                    raise ValueError(
                        f"areas[{place}].rates: {name}: {per_day} is outside {info.interval} 1/day"
                    )
            for earlier in range(place):
                if area.overlaps(self.areas[earlier]):
                    raise ValueError(
                        f"areas[{place}] overlaps areas[{earlier}]: what is first seen in both has"
                        " no one rate; make one of them smaller"
                    )

    def rates(self) -> dict[str, float]:
        """Return the rates by their names, 1/day."""
        names = fields_dict(HypothesesConfig)
        return {name: getattr(self, name) for name in names if name.endswith("_per_day")}


def _least_launch_probability() -> float:
    return number(
        default=0.5,
        minimum=0.0,
        maximum=1.0,
        help="a track that is a launch with a lower probability has no launch point and no"
        " predicted impact",
    )


@frozen
class ImmConfig:
    """Settings of the tracker `imm`."""

    cadence_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.01,
        maximum=60.0,
        help="time between two estimates of a track",
    )
    slice_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.001,
        maximum=10.0,
        help="length of a slice, whose looks update a track together; at most the cadence",
    )
    gate_sigma: float = number(
        default=GATE_SIGMAS, minimum=1.0, maximum=20.0, help="gate, in standard deviations"
    )
    false_alarms_per_sr: float = number(
        default=100.0,
        unit="1/sr",
        above=0.0,
        maximum=1e9,
        help="clutter density: expected false alarms per scan and solid angle",
    )
    needed_scans: int | None = _needed_scans()
    recent_scans: int = _recent_scans()
    association: Any = part(
        role="association",
        default="jpda",
        help="data association: which line of sight belongs to which track",
    )
    initiation: Any = part(
        role="initiation",
        default="m-of-n",
        help="track initiation from lines of sight without a track",
    )
    motion: Any = part(
        role="motion",
        default="thrust",
        state_size=MOTION_STATES,
        help="motion model of a burning target",
    )
    forecast: Any = part(
        role="forecast",
        default="regions",
        help="hypotheses and impact regions of launches, or none of them",
    )
    pruning: Any = part(
        role="pruning",
        default="unlikely",
        help="track deletion: which tracks end",
    )
    modes: str = text(
        default="boost-coast",
        choices=MODES,
        help="motion modes: boost, coast (free flight), or both (IMM)",
    )
    thrust: ThrustConfig = nested(
        default=ThrustConfig(),
        help="priors and process noise of a boost: slowly growing force along the velocity but for"
        " a tilt",
    )
    coast_noise_m_s: float = number(
        default=0.01,
        unit="m/s/√s",
        minimum=0.0,
        maximum=100.0,
        help="process-noise density of the coast mode",
        read_if=_COASTS,
    )
    boost_s: float = number(
        default=150.0,
        unit="s",
        above=0.0,
        maximum=10000.0,
        help="mean duration of a boost",
        read_if=_SWITCHES,
    )
    coast_s: float = number(
        default=1000.0,
        unit="s",
        above=0.0,
        maximum=1e6,
        help="mean duration of a coast before another boost",
        read_if=_SWITCHES,
    )
    hypotheses: HypothesesConfig = nested(
        default=HypothesesConfig(),
        help="prior rates of what a track may be: ground source, launch, bolide, none",
    )
    least_launch_probability: float = _least_launch_probability()
    clock_sigma_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=10.0,
        help="standard deviation of the constant offset of each sensor's clock, which is estimated"
        " as far as lines of"
        " sight show it; what they do not show widens positions along the motion; 0: clocks are"
        " right",
    )
    bias_correlation_s: float = number(
        default=4e6,
        unit="s",
        above=0.0,
        maximum=1e9,
        source="a bias that follows the Sun once a day changes by 2 % of its standard deviation in"
        " 300 s, as a"
        " Gauss–Markov process of 1.4e6 s does; slower, as most of it is not thermal; notional",
        help="Gauss–Markov correlation time of sensors' line-of-sight biases: how slowly they"
        " drift",
        subject="bias",
    )
    late_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=600.0,
        help="detections up to this late are processed in order of time",
    )
    boost_prior: str | None = text(
        default=None,
        help="file of a law of vehicles, as `opir prior fit` writes it; by default the tracker's"
        " own",
    )
    silence_s: float = number(
        default=1800.0,
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
        help="a track with a larger position sigma is deleted once missed detections no longer"
        " explain its silence",
    )

    def __attrs_post_init__(self) -> None:
        _check_scans(self.needed_scans, self.recent_scans)


@frozen
class KeplerArcConfig:
    """Settings of the tracker `kepler-arc`."""

    cadence_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.1,
        maximum=60.0,
        help="time between two estimates of a track",
    )
    needed_scans: int | None = _needed_scans()
    recent_scans: int = _recent_scans()
    forecast: Any = part(
        role="forecast",
        default="arc",
        help="impacts: Keplerian arcs after burnout, or others",
    )
    hypotheses: HypothesesConfig = nested(
        default=HypothesesConfig(),
        help="prior rates of what a track may be: ground source, launch, bolide, none",
    )
    least_launch_probability: float = _least_launch_probability()

    def __attrs_post_init__(self) -> None:
        _check_scans(self.needed_scans, self.recent_scans)

    def imm(self) -> ImmConfig:
        """Return the settings of `imm`, whose tracks fly on the arcs."""
        return ImmConfig(**asdict(self, recurse=False))
