"""The effect of the oblateness of the Earth and the drag of the air on ballistic arcs of a long and
of a short range.
"""

import numpy as np
from attrs import frozen

import opir_core as opir
from opir_core.flight import Drag, Forces, impact
from opir_core.geometry import ecef_to_eci_state
from opir_paper.simulated import scene

#: A class, an aim point, and its distance from the launch point, km.
_ARCS = (("ICBM", (-50.0, -60.0), 7204.0), ("SRBM", (9.5, -100.0), 498.0))

#: The default of a scene with drag, kg/m².
_BALLISTIC_COEFFICIENT_KG_M2 = 5000.0

_DRAG = Drag(_BALLISTIC_COEFFICIENT_KG_M2)


@frozen
class Shift:
    """How far forces that a two-body arc neglects move its impact: on the long and on the short
    arc, km.
    """

    far_km: float
    near_km: float
    far_range_km: float
    near_range_km: float

    @property
    def growth(self) -> float:
        """The shift as a share of the range, on the short arc over the long one."""
        return self.near_km / self.near_range_km / (self.far_km / self.far_range_km)


def shifts() -> dict[str, Shift]:
    """Return the shifts of the impacts of burnout states of two-body flights by the forces that are
    added.
    """
    forces = {
        "J2": Forces(),
        "drag": Forces(zonal=(), drag=_DRAG),
        "J2 and drag": Forces(drag=_DRAG),
    }
    moved = {name: list[float]() for name in forces}
    for kind, aim, _ in _ARCS:
        inertial = _burnout(kind, aim)
        plain_m = impact(*inertial, forces="kepler")[1]
        for name, model in forces.items():
            shift_m = impact(*inertial, forces=model)[1] - plain_m
            moved[name].append(1e-3 * float(np.linalg.norm(shift_m)))
    ranges_km = [range_km for _, _, range_km in _ARCS]
    return {name: Shift(*both_km, *ranges_km) for name, both_km in moved.items()}


def _burnout(kind: str, aim: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the inertial position and velocity at burnout of a flight to an aim point, m and
    m/s.
    """
    lat_deg, lon_deg = aim
    plain = dict(scene(1))
    (target,) = plain["targets"]
    flight = {
        "id": "T",
        "type": kind,
        "launch": target["launch"],
        "aim": {"lat_deg": lat_deg, "lon_deg": lon_deg},
    }
    plain["targets"] = [flight]
    (flown,) = opir.compile_plan(opir.scene_from_mapping(plain)).targets.truth()
    position_m, velocity_m_s = (
        np.array([flown["burnout"][name]]) for name in ("position_ecef_m", "velocity_ecef_m_s")
    )
    return ecef_to_eci_state(position_m, velocity_m_s, 0.0)
