"""Three launches before three geostationary sensors that reckon with light, and their windows."""

import opir_core as opir
from opir_core.interfaces.records import Detections, DetectionTruth
from opir_core.planning import Looks
from opir_core.simulation.engine import Engine

LAUNCHES = (
    {"id": "I", "type": "ICBM", "lat": 5.0, "lon": -150.0, "at": 3.0, "aim": (-50.0, -110.0)},
    {"id": "R", "type": "IRBM", "lat": -3.0, "lon": -140.0, "at": 5.0, "aim": (-28.0, -170.0)},
    {"id": "S", "type": "SRBM", "lat": 2.0, "lon": -135.0, "at": 4.0, "aim": (5.4, -132.0)},
)
#: Each detection is reported: confirmation over scans has tests of its own. Noise is given, without
#: a focal plane.
PLAIN = {"confirmation_detections": 1, "focal_plane": None}
DSP = {
    "model": "DSP",
    "preset": "paper",
    "scan_phase": "random",
    "id": "D",
    "orbital_slot_deg": -140.0,
    **PLAIN,
    "nei_w_m2": 5e-13,
}
SBIRS = {"model": "SBIRS-GEO", "id": "B", "orbital_slot_deg": -150.0, **PLAIN, "nei_w_m2": 1e-12}
NEXTGEN = {
    "model": "NEXTGEN-GEO",
    "id": "N",
    "orbital_slot_deg": -120.0,
    "scan_period_ms": 100.0,
    **PLAIN,
    "nei_w_m2": 1e-13,
    "collection_m2_s": 0.02,
}
#: With such noise that the three launches are near the threshold for seconds: some looks detect and
#: some do not.
NEAR_THRESHOLD = (
    {**DSP, "nei_w_m2": 2.5e-12},
    {**SBIRS, "nei_w_m2": 3e-11},
    {**NEXTGEN, "nei_w_m2": 3e-11},
)


def scene(
    sensors=(DSP, SBIRS, NEXTGEN),
    names="IRS",
    signature="plume",
    **changes,
):
    targets = [
        {
            "id": row["id"],
            "type": row["type"],
            "launch": {"lat_deg": row["lat"], "lon_deg": row["lon"], "time_s": row["at"]},
            "aim": {"lat_deg": row["aim"][0], "lon_deg": row["aim"][1]},
            "signature": signature,
        }
        for row in LAUNCHES
        if row["id"] in names
    ]
    mapping = {
        "scene": "light",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60,
        "seed": 5,
        "sensors": list(sensors),
        "targets": targets,
        "detection": {"model": "snr"},
        "outputs": [],
    }
    return opir.scene_from_mapping({**mapping, **changes})


def windows_of(plan, edges_s):
    engine = Engine(plan)
    return [engine.advance(round(edge * 1e9)) for edge in edges_s]


def looks_of(plan, step=7):
    """Return the exposures of every so many looks of a plan."""
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    return plan.look_geometry().exposures(looks.pair[::step], looks.scan[::step])


def joined(windows):
    return (
        Detections.concatenate(window.detections for window in windows),
        DetectionTruth.concatenate(window.truth for window in windows),
    )
