"""A scene of two sensors that do not watch for a while, in two parts: the sensors, and the target with
the spans in which they watch.
"""

SCENE = """\
scene: beats
epoch: 2026-04-01T12:00:00Z
duration_s: 60
seed: 53
sensors:
  - {model: SBIRS-GEO, id: WEST, orbital_slot_deg: -135, scan_period_ms: 500}
  - {model: SBIRS-GEO, id: EAST, orbital_slot_deg: -75, scan_period_ms: 500}
tracker: imm
"""
TARGET = """\
targets:
  - {id: T, type: ICBM, launch: {lat_deg: 34, lon_deg: -120, time_s: 2}, aim: {lat_deg: 9, lon_deg: 167}}
watched_s: {WEST: [[0, 40], [52, 60]], EAST: [[0, 40], [52, 60]]}
"""
