"""What a scene may set of sources that move or flash. Nothing heavy is imported here."""

from typing import ClassVar

from attrs import frozen

from opir_core.plugin import cited, flag, nested, number, text, with_defaults
from opir_photons.radiometry.source_configs import PlacedConfig, PlacesConfig, SourceConfig

_DAYLIGHT_1972 = "daylight fireball of 10 August 1972: 15 km/s, perigee 57 km, 100 s in the air"
_STROKES = "1174 negative flashes: Poelman et al., Nat. Hazards Earth Syst. Sci. 21 (2021), 1909"


@frozen
class MoverConfig(SourceConfig):
    """What a scene may set of every source that moves over the ground: it is at its place at
    `start_s` and shines from then on.
    """

    more_own_fields: ClassVar[tuple[str, ...]] = ("heading_deg", "speed_m_s")

    start_s: float = number(
        default=0.0,
        unit="s",
        minimum=-86_400.0,
        help="scene time at which it is at its place, and from which it shines",
        source="the scene's begin",
    )
    heading_deg: float | None = number(
        default=None,
        unit="deg",
        minimum=0.0,
        maximum=360.0,
        help="direction of motion, from north over east",
        source="none: random, each its own",
    )
    speed_m_s: float = number(
        default=10.0, unit="m/s", minimum=0.0, maximum=1500.0, help="speed over the ground"
    )


@with_defaults(speed_m_s=8.0, height_m=30.0, temperature_k=600.0, emissivity=0.9, area_m2=4.0)
class ShipConfig(MoverConfig):
    """What a scene may set of `ships`: funnels that shine alike to all sides."""


@with_defaults(speed_m_s=25.0, height_m=5.0, temperature_k=750.0, emissivity=0.9, area_m2=0.3)
class TrainConfig(MoverConfig):
    """What a scene may set of `trains`: exhausts that shine alike to all sides."""


@with_defaults(
    speed_m_s=cited(
        2.0,
        "grass fires, 1.6 to 17 km/h: Cruz et al., Fire 5 (2022), 55",
    ),
    temperature_k=cited(
        1000.0,
        "flaming vegetation, 800 to 1200 K: Dozier, Remote Sensing of Environment 11 (1981),"
        " 221-229",
    ),
    emissivity=0.9,
    area_m2=20_000.0,
)
class FireFrontConfig(MoverConfig):
    """What a scene may set of `fire_fronts`: flat grey bodies; the area is the length of the front
    times the depth of its flames, by default 2 km times 10 m.
    """


@with_defaults(speed_m_s=15.0, height_m=30e3, temperature_k=230.0, emissivity=0.3, area_m2=3000.0)
class BalloonConfig(MoverConfig):
    """What a scene may set of `balloons`: spheres of a cross-section `area_m2` that reflect
    sunlight.
    """

    more_own_fields = (*MoverConfig.more_own_fields, "albedo")

    albedo: float = number(
        default=0.3, minimum=0.0, maximum=1.0, help="share of the sunlight that it reflects"
    )


@frozen
class SatelliteConfig(PlacedConfig):
    """What a scene may set of `satellites`: at `start_s` they are over their places, on circular
    orbits; spheres of a cross-section `area_m2`.
    """

    more_own_fields = ("heading_deg", "albedo")

    field: PlacesConfig | None = nested(
        default=None, help="satellites over random places", source="no default: at, csv or field"
    )
    start_s: float = number(
        default=0.0,
        unit="s",
        minimum=-86_400.0,
        help="scene time at which it is over its place, and from which it shines",
        source="the scene's begin",
    )
    end_s: float | None = number(
        default=None,
        unit="s",
        help="scene time to which it shines",
        source="none: beyond the scene's end",
    )
    height_m: float = number(
        default=550e3,
        unit="m",
        minimum=150e3,
        maximum=1e8,
        help="height above the ellipsoid at its place",
    )
    heading_deg: float | None = number(
        default=None,
        unit="deg",
        minimum=0.0,
        maximum=360.0,
        help="direction of motion in inertial space, from north over east",
        source="none: random, each its own",
    )
    area_m2: float = number(default=10.0, unit="m2", above=0.0, maximum=1e5, help="cross-section")
    albedo: float = number(
        default=0.3, minimum=0.0, maximum=1.0, help="share of the sunlight that it reflects"
    )
    temperature_k: float = number(
        default=300.0, unit="K", above=0.0, maximum=1000.0, help="temperature of its surface"
    )
    emissivity: float = number(default=0.8, above=0.0, maximum=1.0, help="emissivity")


@frozen
class LegConfig:
    """One leg of a flight: straight with an acceleration, or a level or climbing turn; after the
    last leg the aircraft flies straight and level.
    """

    for_s: float = number(unit="s", above=0.0, maximum=86_400.0, help="duration")
    climb_m_s: float = number(
        default=0.0, unit="m/s", minimum=-500.0, maximum=500.0, help="rate of climb"
    )
    bank_deg: float = number(
        default=0.0,
        unit="deg",
        minimum=-85.0,
        maximum=85.0,
        help="bank, to the right above 0: a turn of radius speed²/(g tan bank)",
    )
    acceleration_m_s2: float = number(
        default=0.0, unit="m/s2", minimum=-50.0, maximum=50.0, help="along the course"
    )
    afterburner: bool = flag(default=False, help="whether the afterburner burns")

    def __attrs_post_init__(self) -> None:
        if self.bank_deg != 0.0 and self.acceleration_m_s2 != 0.0:
            raise ValueError(
                "a leg has either bank_deg or acceleration_m_s2: divide it into two legs"
            )


@with_defaults(
    speed_m_s=240.0,
    height_m=10e3,
    temperature_k=850.0,
    emissivity=cited(
        0.9,
        "a tailpipe is a grey body of 0.9 at the exhaust gas temperature, as wide as the nozzle:"
        " R. D. Hudson, Infrared System Engineering, Wiley (1969)",
    ),
    area_m2=0.6,
)
class AircraftConfig(MoverConfig):
    """What a scene may set of `aircraft`: tailpipes, seen from behind, and the flame of
    afterburners, seen from all sides.
    """

    legs: tuple[LegConfig, ...] = nested(
        default=(),
        help="legs of the flight, in order, of each aircraft of the block",
        source="none: straight and level",
    )
    afterburner: bool = flag(
        default=False, help="whether the afterburner burns outside of the legs"
    )
    flame_temperature_k: float = number(
        default=2000.0, unit="K", above=0.0, maximum=20_000.0, help="temperature of the flame"
    )
    flame_area_m2: float = number(
        default=1.5,
        unit="m2",
        above=0.0,
        maximum=1e4,
        help="emissivity times area of the flame, from all sides",
    )
    pull_m_s2: float = number(
        default=5.0,
        unit="m/s2",
        above=0.0,
        maximum=100.0,
        help="vertical acceleration from one rate of climb to the next",
    )


@with_defaults(start_s=0.0, height_m=120e3, temperature_k=300.0, emissivity=0.8, area_m2=2.0)
class ReentryConfig(SourceConfig):
    """What a scene may set of `reentries`: at `start_s` a body is at its place; the air makes
    `area_m2` of it, as seen, as hot as the stagnation point of its nose.

    `temperature_k` is that above the air.
    """

    more_own_fields = (
        "speed_m_s",
        "descent_deg",
        "heading_deg",
        "ballistic_coefficient_kg_m2",
        "nose_radius_m",
    )

    speed_m_s: float = number(
        default=7600.0,
        unit="m/s",
        above=0.0,
        maximum=12_000.0,
        help="speed relative to the Earth",
        source="decay from a low orbit to the east, less the Earth's rotation",
    )
    descent_deg: float = number(
        default=1.5,
        unit="deg",
        minimum=-90.0,
        maximum=90.0,
        help="angle of the way below the horizontal; a spent stage that still climbs has one below 0",
    )
    heading_deg: float | None = number(
        default=None,
        unit="deg",
        minimum=0.0,
        maximum=360.0,
        help="direction, from north over east",
        source="none: random, each its own",
    )
    ballistic_coefficient_kg_m2: float = number(
        default=100.0,
        unit="kg/m2",
        minimum=1.0,
        maximum=1e5,
        help="mass over drag coefficient times area",
    )
    nose_radius_m: float = number(
        default=0.5,
        unit="m",
        above=0.0,
        maximum=100.0,
        help="radius of the nose that meets the air",
    )
    lowest_m: float = number(
        default=15e3,
        unit="m",
        minimum=0.0,
        maximum=100e3,
        help="height at which it is dark: it is followed down to there",
    )
    fragments: int = number(
        default=0,
        minimum=0,
        maximum=1000,
        help="fragments of equal mass and like shape that each body breaks up into; 0: it does not",
        source="none: one body",
    )
    break_up_m: float = number(
        default=78e3,
        unit="m",
        minimum=0.0,
        maximum=120e3,
        help="height at which it breaks up",
        source="notional: bodies from orbits break up at 70 to 80 km",
    )
    fragment_spread: float = number(
        default=3.0,
        minimum=1.0,
        maximum=100.0,
        help="factor either way in which the ballistic coefficients of nine in ten fragments are",
    )

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        if self.fragments and self.break_up_m <= self.lowest_m:
            raise ValueError(
                f"break_up_m {self.break_up_m:g} is not above lowest_m {self.lowest_m:g}: raise it, or"
                " lower lowest_m"
            )


@frozen
class SpentStagesConfig:
    """What a scene may set of `spent_stages`: the stages that one of its launches drops."""

    launch: str = text(help="id of the target that drops them", source="no default")
    stages: int | None = number(
        default=None,
        minimum=1,
        maximum=8,
        help="equal stages of a flight in one burn; flights in several burns drop one after each",
        source="none: those of the flown profile's plume",
    )
    drops_last: bool | None = flag(
        default=None,
        help="whether the last stage is dropped at burnout",
        source="none: gliders drop it, other classes keep it",
    )
    ballistic_coefficient_kg_m2: float = number(
        default=150.0,
        unit="kg/m2",
        minimum=1.0,
        maximum=1e5,
        help="mass over drag coefficient times area",
    )
    area_m2: float = number(
        default=12.0,
        unit="m2",
        above=0.0,
        maximum=1e4,
        help="cross-section on average over directions: a quarter of the surface",
    )
    temperature_k: float = number(
        default=300.0, unit="K", above=0.0, maximum=1000.0, help="temperature without air"
    )
    emissivity: float = number(default=0.8, above=0.0, maximum=1.0, help="emissivity")
    albedo: float = number(
        default=0.3, minimum=0.0, maximum=1.0, help="share of the sunlight that it reflects"
    )
    lowest_m: float = number(
        default=15e3,
        unit="m",
        minimum=0.0,
        maximum=100e3,
        help="height at which it is dark: it is followed down to there",
    )


@with_defaults(
    start_s=0.0,
    height_m=cited(57e3, _DAYLIGHT_1972),
    temperature_k=4500.0,
    emissivity=1.0,
    area_m2=30.0,
)
class GrazerConfig(SourceConfig):
    """What a scene may set of `grazers`: `height_m` over their place is that of perigee, which
    they pass in the middle of `shining_s`; they are as bright as the energy of the air that they
    meet.
    """

    more_own_fields = ("speed_m_s", "heading_deg", "shining_s")

    speed_m_s: float = number(
        default=15_000.0,
        unit="m/s",
        minimum=8000.0,
        maximum=72_000.0,
        help="speed at perigee, relative to the Earth",
        source=_DAYLIGHT_1972,
    )
    heading_deg: float | None = number(
        default=None,
        unit="deg",
        minimum=0.0,
        maximum=360.0,
        help="direction at perigee, from north over east",
        source="none: random, each its own",
    )
    shining_s: float = number(
        default=100.0,
        unit="s",
        above=0.0,
        maximum=600.0,
        help="how long it shines, from start_s on",
        source=_DAYLIGHT_1972,
    )


@frozen
class StormConfig(PlacedConfig):
    """What a scene may set of `storms`: each place is the middle of a thunderstorm, each flash of
    lightning one emitter.
    """

    more_own_fields = ("flashes_per_minute", "radius_m", "bottom_m", "top_m", "energy_j")

    field: PlacesConfig | None = nested(
        default=None, help="storms at random places", source="no default: at, csv or field"
    )
    start_s: float = number(
        default=0.0, unit="s", minimum=-86_400.0, help="scene time from which it flashes"
    )
    end_s: float | None = number(
        default=None,
        unit="s",
        help="scene time to which it flashes",
        source="none: beyond the scene's end",
    )
    flashes_per_minute: float = number(
        default=3.0,
        unit="1/min",
        above=0.0,
        maximum=1000.0,
        help="mean rate of flashes",
        source="mean over the life of a cell: Cianos and Pierce, Stanford Research Institute (1972)",
    )
    interval_log_sigma: float = number(
        default=1.0,
        minimum=0.0,
        maximum=3.0,
        help="standard deviation of the natural logarithm of the intervals between flashes",
        source="Dennis, J. Atmos. Sci. 27 (1970), 170",
    )
    radius_m: float = number(
        default=8000.0, unit="m", minimum=0.0, maximum=1e6, help="radius in which it flashes"
    )
    bottom_m: float = number(
        default=6000.0, unit="m", minimum=0.0, maximum=30e3, help="lowest height of flashes"
    )
    top_m: float = number(
        default=14e3, unit="m", minimum=0.0, maximum=30e3, help="greatest height of flashes"
    )
    strokes: float = number(
        default=3.67, minimum=1.0, maximum=50.0, help="mean number of strokes", source=_STROKES
    )
    duration_s: float = number(
        default=0.371,
        unit="s",
        above=0.0,
        maximum=10.0,
        help="mean duration of flashes of several strokes",
        source=_STROKES,
    )
    stroke_interval_s: float = number(
        default=0.062,
        unit="s",
        above=0.0,
        maximum=10.0,
        help="geometric mean of the intervals between strokes",
        source="1085 flashes: Zhu et al., J. Atmos. Sol.-Terr. Phys. 136 (2015), 16",
    )
    glow_s: float = number(
        default=0.04, unit="s", above=0.0, maximum=1.0, help="how long a stroke glows after"
    )
    energy_j: float = number(
        default=450e3,
        unit="J",
        above=0.0,
        maximum=1e12,
        help="median energy of a stroke's light, 0.4 to 1.1 µm, to all sides",
        source="FORTE: Kirkland et al., J. Geophys. Res. 106 (2001), 33499",
    )
    energy_log_sigma: float = number(
        default=1.6,
        minimum=0.0,
        maximum=5.0,
        help="standard deviation of the natural logarithm of the energies of flashes",
        source="two flashes in a thousand are over 100 times as bright as typical: Turman,"
        " J. Geophys. Res. 82 (1977), 2566",
    )
    temperature_k: float = number(
        default=10_000.0,
        unit="K",
        above=0.0,
        maximum=50_000.0,
        help="temperature of the grey body that shares the energy between wavelengths",
    )

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        if self.bottom_m > self.top_m:
            raise ValueError(f"bottom_m {self.bottom_m:g} is above top_m {self.top_m:g}")
        if self.duration_s < self.strokes * self.stroke_interval_s:
            raise ValueError(
                f"duration_s {self.duration_s:g} is too short for flashes of {self.strokes:g} strokes"
                f" every {self.stroke_interval_s:g} s"
            )
