"""The target models `gravity-turn`, `orbit`, `glide` and `air-launch`: a plugin of their own, imported for scenes
that name one.
"""

from collections.abc import Iterable
from typing import Any

from attrs import frozen

from opir_core.builtin.configs import TYPE_HELP, AimConfig, BallisticConfig, LaunchConfig, drag
from opir_core.doors import deferred
from opir_core.host.components import TargetModel
from opir_core.host.hookspecs import hookimpl
from opir_core.scene.fields import BODIES, nested, number, text
from opir_core.scene.target_classes import TargetClass

#: The most burns of a target, as many as plumes have factors for.
MOST_STAGES = 8

#: The highest apogee of a gravity turn, km: such a flight lasts 15 h; free flight is followed for a
#: day.
MAX_APOGEE_KM = 50_000.0


def _stages_complaint(stages: tuple[Any, ...]) -> str | None:
    return (
        f"there are {len(stages)} stages; at most {MOST_STAGES} are possible"
        if len(stages) > MOST_STAGES
        else None
    )


@frozen
class InsertionConfig:
    """What a scene may set of a target of the model `orbit`."""

    type: str = text(names_of=TargetClass.hook, help=TYPE_HELP)
    launch: LaunchConfig = nested(help="launch point and time")
    azimuth_deg: float = number(
        unit="deg",
        minimum=0.0,
        below=360.0,
        help="launch azimuth over the rotating Earth, clockwise from true north",
    )
    altitude_km: float | None = number(
        default=None,
        unit="km",
        minimum=150.0,
        maximum=600.0,
        help="altitude of the circular orbit above the equatorial radius; default: the class's",
    )
    followed_s: float = number(
        default=6000.0,
        unit="s",
        above=0.0,
        maximum=86_400.0,
        source="a revolution of a low orbit takes about 5400 s",
        help="time after burnout in which sensors that follow bodies observe the target",
        subject=BODIES,
    )
    ballistic_coefficient_kg_m2: float | None = drag("in orbit")


@frozen
class GlideConfig:
    """What a scene may set of a target of the model `glide`."""

    type: str = text(names_of=TargetClass.hook, help=TYPE_HELP)
    launch: LaunchConfig = nested(help="launch point and time")
    aim: AimConfig = nested(help="aim point")
    ballistic_coefficient_kg_m2: float | None = drag("after the glide")


@frozen
class StageConfig:
    """One burn of a target of the model `gravity-turn`."""

    burn_time_s: float = number(
        unit="s",
        minimum=10.0,
        maximum=1000.0,
        help="from ignition to the end of the tail-off; the last burn may end early",
    )
    ideal_speed_m_s: float = number(
        unit="m/s",
        minimum=100.0,
        maximum=12_000.0,
        help="speed gained by the whole burn, without gravity and drag",
    )
    growth: float = number(
        default=2.0,
        minimum=0.2,
        maximum=20.0,
        help="acceleration at the end of the burn over that at its start",
    )
    gap_s: float = number(
        default=0.0, unit="s", minimum=0.0, maximum=300.0, help="dark time before the next burn"
    )


@frozen
class GravityTurnConfig:
    """What a scene may set of a target of the model `gravity-turn`."""

    type: str = text(names_of=TargetClass.hook, help=TYPE_HELP)
    launch: LaunchConfig = nested(help="launch point and time")
    aim: AimConfig = nested(help="aim point")
    staging: str | None = text(
        default=None,
        help="preset of stages; default: that of the target type for the range to the aim point",
    )
    stages: tuple[StageConfig, ...] = nested(
        default=(),
        check=_stages_complaint,
        help="the burns, in order, instead of those of the preset",
    )
    loft: float = number(
        default=0.0,
        minimum=-1.0,
        maximum=1.0,
        help="0: minimum energy (the earliest cut-off of the last burn); 1: the steepest flight"
        " that the stages can fly"
        " to the aim point, -1: the flattest; the apogee is linear between these",
    )
    apogee_km: float | None = number(
        default=None,
        unit="km",
        minimum=1.0,
        maximum=MAX_APOGEE_KM,
        instead_of="loft",
        help="height of the apogee above the ellipsoid",
    )
    early_shutdown_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=1000.0,
        help="how much earlier than for the aim point the last burn is cut off; the target then"
        " falls short",
    )
    vertical_rise_s: float | None = number(
        default=None,
        unit="s",
        minimum=1.0,
        maximum=100.0,
        help="vertical flight; default: the preset's",
    )
    pitch_over_s: float | None = number(
        default=None,
        unit="s",
        minimum=1.0,
        maximum=200.0,
        help="duration of the pitch-over; default: the preset's",
    )
    tail_off_s: float | None = number(
        default=None,
        unit="s",
        minimum=0.01,
        maximum=30.0,
        help="time in which the thrust of each burn falls to zero, at its end; default: the"
        " preset's",
    )
    boost_ballistic_coefficient_kg_m2: float | None = number(
        default=None,
        unit="kg/m²",
        minimum=100.0,
        maximum=1e12,
        help="m/(C_d A) during the boost; default: the preset's",
    )
    ballistic_coefficient_kg_m2: float | None = drag("in free flight")


@frozen
class AirConfig(LaunchConfig):
    """Where, how high and when a target ignites in the air."""

    height_m: float = number(
        default=11_000.0,
        unit="m",
        minimum=0.0,
        maximum=30_000.0,
        help="height above the WGS 84 ellipsoid",
    )


@frozen
class AirLaunchConfig:
    """What a scene may set of a target of the model `air-launch`."""

    type: str = text(names_of=TargetClass.hook, help=TYPE_HELP)
    launch: AirConfig = nested(help="point and time of ignition, in level flight")
    heading_deg: float = number(
        unit="deg",
        minimum=0.0,
        maximum=360.0,
        help="direction of flight over the rotating Earth, clockwise from true north",
    )
    speed_m_s: float = number(
        default=240.0,
        unit="m/s",
        minimum=10.0,
        maximum=1500.0,
        help="speed at ignition, relative to the Earth",
    )
    climb_deg: float = number(
        default=45.0,
        unit="deg",
        minimum=5.0,
        maximum=85.0,
        help="flight path angle above the horizontal after the pull-up",
    )
    pull_m_s2: float = number(
        default=30.0,
        unit="m/s²",
        minimum=1.0,
        maximum=300.0,
        help="acceleration across the course as the pull-up begins",
    )
    burn_time_s: float | None = number(
        default=None,
        unit="s",
        minimum=5.0,
        maximum=1000.0,
        help="burn time; default: that of the class's first profile",
    )
    speed_gain_m_s: float | None = number(
        default=None,
        unit="m/s",
        minimum=100.0,
        maximum=7500.0,
        help="speed gained in the burn; default: the burnout speed of the class's first profile",
    )
    ballistic_coefficient_kg_m2: float | None = drag("in free flight")


#: The settings of a target that flies as its class does.
ClassConfig = BallisticConfig | InsertionConfig | GlideConfig | GravityTurnConfig | AirLaunchConfig


@hookimpl
def opir_target_models() -> Iterable[TargetModel]:
    """Yield `gravity-turn`, `orbit`, `glide` and `air-launch`."""
    yield TargetModel(
        name="air-launch",
        summary="ignition in level flight at a height and a speed, a pull-up, boost as a class's,"
        " then free flight",
        config=AirLaunchConfig,
        build=deferred("opir_core.builtin.air_launch_targets.air_launch_targets"),
    )
    yield TargetModel(
        name="gravity-turn",
        summary="a gravity turn of one to several burns with dark gaps, aimed by kick and cut-off,"
        " then free flight",
        config=GravityTurnConfig,
        build=deferred("opir_core.builtin.gravity_turn_targets.gravity_turn_targets"),
    )
    yield TargetModel(
        name="orbit",
        summary="boost on a class profile into a circular orbit",
        config=InsertionConfig,
        build=deferred("opir_core.builtin.orbit_targets.orbit_targets"),
    )
    yield TargetModel(
        name="glide",
        summary="boost on a class profile, equilibrium glide at a constant lift-to-drag ratio, and"
        " free fall",
        config=GlideConfig,
        reads=(BODIES,),
        build=deferred("opir_core.builtin.glide_targets.glide_targets"),
    )
