"""A scene that an operator directs: two wide sensors, one with a narrow field, and a launch."""

OPERATED_SCENE = """\
scene: operated
epoch: "2026-04-01T12:00:00Z"
duration_s: 600
seed: 5
sensors:
  - {model: generic-scanner, id: WEST, orbital_slot_deg: -150.0}
  - {model: generic-scanner, id: EAST, orbital_slot_deg: -90.0}
  - {model: generic-pointed, id: SPOT, orbital_slot_deg: -100.0, modes: {stare: {settle_s: 4.0}}}
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 1.0}
    aim: {lat_deg: 9.0, lon_deg: 167.7}
tracker: imm
director: operator
outputs: ["null"]
"""
