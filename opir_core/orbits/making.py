"""From an `orbit:` block to the orbit. What an orbit needs is imported when it is made."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from opir_core.errors import Problem, SceneError
from opir_core.orbits.configs import (
    CircularConfig,
    KeplerConfig,
    MolniyaConfig,
    OmmFileConfig,
    OrbitConfig,
    SlotConfig,
    WalkerConfig,
)
from opir_core.orbits.elements import Elements, mean_anomaly_rad
from opir_core.orbits.families import circular_elements, highly_elliptical_elements, slot_elements, walker_pattern
from opir_core.orbits.mean_elements import omm_complaint, omm_name

if TYPE_CHECKING:
    from opir_core.interfaces.protocols import Orbit

#: How an OMM may be named in a file of several.
_OMM_NAMES = ("OBJECT_NAME", "OBJECT_ID", "NORAD_CAT_ID")


def orbit_of(config: OrbitConfig, epoch_us: int) -> "Orbit":
    """Return the orbit of a configuration, for scenes that start at an epoch, in microseconds of UTC since 1970.

    Raises `SceneError` for a file that cannot be read, `ModelError` for a satellite that SGP4 cannot follow to the
    scene epoch, and `PluginError` where the package sgp4 is needed and not installed.
    """
    slot = config.slot
    if slot is not None and slot.inclination_deg == 0.0 and slot.eccentricity == 0.0:
        from opir_core.orbits.moving import GeostationaryOrbit

        return GeostationaryOrbit(slot.lon_deg)
    elements = elements_of(config, epoch_us)
    if elements is None:
        return _sgp4_orbit(config, epoch_us)
    from opir_core.orbits.moving import MovingOrbit, TwoBodyMotion

    return MovingOrbit(TwoBodyMotion(elements))


def elements_of(config: OrbitConfig, epoch_us: int) -> Elements | None:
    """Return the Kepler elements of a configuration at an epoch; None for one that SGP4 follows."""
    if config.slot is not None:
        return _slot(config.slot)
    if config.kepler is not None:
        return _kepler(config.kepler, epoch_us)
    if config.circular is not None:
        return _circular(config.circular, epoch_us)
    if config.walker is not None:
        return _walker(config.walker, epoch_us)
    elliptical = config.molniya or config.tundra
    return None if elliptical is None else _highly_elliptical(elliptical)


def _slot(config: SlotConfig) -> Elements:
    return slot_elements(
        math.radians(config.lon_deg),
        inclination_rad=math.radians(config.inclination_deg),
        eccentricity=config.eccentricity,
        argument_of_perigee_rad=math.radians(config.arg_perigee_deg),
        mean_argument_of_latitude_rad=math.radians(config.mean_arg_latitude_deg),
    )


def _kepler(config: KeplerConfig, epoch_us: int) -> Elements:
    if config.mean_anomaly_deg is not None:
        anomaly_rad = math.radians(config.mean_anomaly_deg)
    else:
        anomaly_rad = mean_anomaly_rad(math.radians(config.true_anomaly_deg or 0.0), config.eccentricity)
    return Elements(
        semi_major_axis_m=config.semi_major_axis_km * 1e3,
        eccentricity=config.eccentricity,
        inclination_rad=math.radians(config.inclination_deg),
        node_longitude_rad=_node_longitude_rad(config, epoch_us),
        argument_of_perigee_rad=math.radians(config.arg_perigee_deg),
        mean_anomaly_rad=anomaly_rad,
    )


def _circular(config: CircularConfig, epoch_us: int) -> Elements:
    return circular_elements(
        config.altitude_km * 1e3,
        math.radians(config.inclination_deg),
        _node_longitude_rad(config, epoch_us),
        math.radians(config.arg_latitude_deg),
    )


def _walker(config: WalkerConfig, epoch_us: int) -> Elements:
    pattern = walker_pattern(
        config.total,
        config.planes,
        config.phasing,
        config.altitude_km * 1e3,
        math.radians(config.inclination_deg),
        star=config.kind == "star",
        first_node_longitude_rad=_node_longitude_rad(config, epoch_us),
        first_argument_of_latitude_rad=math.radians(config.arg_latitude_deg),
    )
    return pattern[config.satellite - 1]


def _highly_elliptical(config: MolniyaConfig) -> Elements:
    return highly_elliptical_elements(
        config.turns_a_day,
        config.eccentricity,
        math.radians(config.apogee_lon_deg),
        config.apogee_time_s,
        inclination_rad=math.radians(config.inclination_deg),
        argument_of_perigee_rad=math.radians(config.arg_perigee_deg),
    )


def _node_longitude_rad(config: KeplerConfig | CircularConfig | WalkerConfig, epoch_us: int) -> float:
    """Return the east longitude of the ascending node at the scene epoch."""
    if config.lon_asc_node_deg is not None:
        return math.radians(config.lon_asc_node_deg)
    import numpy as np

    from opir_core.geometry import gmst_rad

    return math.radians(config.raan_deg or 0.0) - float(gmst_rad(np.datetime64(epoch_us, "us")))


def _sgp4_orbit(config: OrbitConfig, epoch_us: int) -> "Orbit":
    import numpy as np

    from opir_core.orbits.moving import MovingOrbit
    from opir_core.orbits.sgp4_motion import Sgp4Motion, satellite_of_omm, satellite_of_tle

    if config.tle is not None:
        satellite, name = satellite_of_tle(config.tle), f"object {config.tle[0][2:7].strip()}"
    else:
        omm = config.omm if config.omm_file is None else omm_of_file(config.omm_file)
        assert omm is not None  # an OrbitConfig holds exactly one kind of orbit
        satellite, name = satellite_of_omm(omm), omm_name(omm)
    motion = Sgp4Motion(satellite, epoch_us, name)
    motion.position_teme_m(np.zeros(1))
    return MovingOrbit(motion)


def omm_of_file(config: OmmFileConfig) -> Mapping[str, Any]:
    """Return the OMM that a configuration names; raises `SceneError` where there is none, or not exactly one."""
    import json

    try:
        data = json.loads(Path(config.path).read_text(encoding="utf-8"))
    except OSError as error:
        raise _refused(config, f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise _refused(config, f"is not JSON: {error}") from error
    messages = [message for message in (data if isinstance(data, list) else [data]) if isinstance(message, dict)]
    if config.satellite is not None:
        messages = [m for m in messages if config.satellite in (str(m.get(name)) for name in _OMM_NAMES)]
    if len(messages) != 1:
        which = "" if config.satellite is None else f" of {config.satellite}"
        raise _refused(config, f"holds {len(messages)} OMM{which}; exactly one is needed{_hint(config, messages)}")
    complaint = omm_complaint(messages[0])
    if complaint:
        raise _refused(config, complaint)
    return messages[0]


def _hint(config: OmmFileConfig, messages: list[dict[str, Any]]) -> str:
    return "; say which with satellite" if config.satellite is None and messages else ""


def _refused(config: OmmFileConfig, message: str) -> SceneError:
    return SceneError([Problem("", message)], source=config.path)
