"""What the oblateness of the Earth does to ballistic arcs of a long and of a short range."""

import numpy as np

import opir_core as opir
from opir_core.flight import impact
from opir_core.geometry import ecef_to_eci_state
from opir_paper.simulated import scene

#: A class and an aim point: 9 000 km and 500 km from the launch point.
_ARCS = (("ICBM", (-50.0, -60.0)), ("SRBM", (9.5, -100.0)))


def j2_shifts_km() -> tuple[float, float]:
    """Return how far J2 moves the impacts of burnout states of two-body flights of a long and of a
    short range, km.
    """
    shifts_km = []
    for kind, (lat_deg, lon_deg) in _ARCS:
        plain = dict(scene(1))
        (target,) = plain["targets"]
        aim = {"lat_deg": lat_deg, "lon_deg": lon_deg}
        plain["targets"] = [{"id": "T", "type": kind, "launch": target["launch"], "aim": aim}]
        (flown,) = opir.compile_plan(opir.scene_from_mapping(plain)).targets.truth()
        position, velocity = (
            np.array([flown["burnout"][name]]) for name in ("position_ecef_m", "velocity_ecef_m_s")
        )
        inertial = ecef_to_eci_state(position, velocity, 0.0)
        points_m = [impact(*inertial, forces="kepler")[1], impact(*inertial)[1]]
        shifts_km.append(1e-3 * float(np.linalg.norm(points_m[1] - points_m[0])))
    return shifts_km[0], shifts_km[1]
