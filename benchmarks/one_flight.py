"""Scenes of one flight before one or two SBIRS-GEO, and the rows of its track."""

import numpy as np
from opir_scoring.impacts import main_regions, regions_given

import opir_core as opir

#: Ignition in the scene, s.
START_S = 10.0
CONTAINMENT = 0.95


def write_table(path, rows):
    """Write rows (n, 8) of time since ignition, ECEF state and burning as the target model `table`
    reads them.
    """
    head = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"
    form = ["%.6f", *["%.4f"] * 3, *["%.6f"] * 3, "%d"]
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt=form)


def table_target(path, kind):
    """Return the target of a table."""
    return {"id": "T", "model": "table", "type": kind, "file": str(path), "start_s": START_S}


def flight_scene(
    target,
    longitude_deg,
    duration_s,
    seed,
    sensors=2,
    tracker="imm",
    **settings,
):
    """Return the scene of a target before sensors on both sides of its launch; `settings` are
    theirs.
    """
    slots_deg = [(longitude_deg + shift + 540.0) % 360.0 - 180.0 for shift in (-35.0, 30.0)]
    return opir.scene_from_mapping(
        {
            "scene": "flight",
            "epoch": "2026-04-01T18:00:00Z",
            "duration_s": float(np.ceil(duration_s)),
            "seed": seed,
            "sensors": [
                {
                    "model": "SBIRS-GEO",
                    "id": f"S{slot_deg:.2f}",
                    "orbital_slot_deg": slot_deg,
                    **settings,
                }
                for slot_deg in slots_deg[:sensors]
            ],
            "targets": [target],
            "tracker": tracker,
        }
    )


def longest_track(tracks):
    """Return the rows of the track with most ticks: false ones are short."""
    number, count = np.unique(tracks.track, return_counts=True)
    longest = number[np.argmax(count)] if len(number) else -1
    return tracks.take(np.flatnonzero(tracks.track == longest))


def impact_containment(track, row, impact, is_over):
    """Return whether an impact, rad, lies in the 95 % region of the likeliest condition, and in
    that of the true one ("the burn is over" or not); nan without a region.
    """
    regions = [
        impact_region
        for impact_region in track.impact_regions[row]
        if impact_region.containment == CONTAINMENT
    ]
    if impact is None or not regions:
        return np.nan, np.nan
    inputs = regions_given(regions, is_over)
    inside = float(main_regions(regions)[0].contains(*impact))
    return inside, float(inputs[0].contains(*impact)) if inputs else np.nan
