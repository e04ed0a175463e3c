"""Lines of sight that contradict each other, or begin no track: the reason is named."""

import csv

import numpy as np
import pytest
from opir_readers.detections.meeting import Lines, slips_of_pair

from opir_core.cli.main import main

GEO_M = 42_164_172.0
SLOTS_DEG = {"WEST": -135.0, "EAST": -75.0}
START = np.datetime64("2026-04-01T12:00:10", "us")
SENSORS = "sensors:\n" + "".join(
    f"  - {{model: SBIRS-GEO, id: {name}, orbital_slot_deg: {slot}, scan_period_ms: 1000}}\n"
    for name, slot in SLOTS_DEG.items()
)


def source_m(time_s):
    """Return the place of a source that climbs from 34° N 120° W, m in ECEF.

    It is pushed by 20 m/s² upwards, and flies north with 2 km/s.
    """
    latitude = np.radians(34.0) + 2000.0 * time_s / 6.4e6
    longitude = np.radians(-120.0)
    radius = 6_371_900.0 + 10.0 * time_s**2
    flat = np.cos(latitude)
    return radius * np.array([flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)])


def angles_deg(slot_deg, place):
    """Return azimuth from north over east and elevation of a place from a geostationary sensor, deg."""
    slot = np.radians(slot_deg)
    up = np.array([np.cos(slot), np.sin(slot), 0.0])
    east = np.array([-np.sin(slot), np.cos(slot), 0.0])
    line = place - GEO_M * up
    line /= np.linalg.norm(line)
    return float(np.degrees(np.arctan2(line @ east, line[2])) % 360.0), float(
        np.degrees(np.arcsin(line @ up))
    )


def rows(step_s=1.0, last_s=20.0, late_s=0.0):
    """Return lines of both sensors; those of EAST have a clock that is late."""
    found = []
    for number, (name, slot) in enumerate(SLOTS_DEG.items()):
        for time_s in np.arange(0.2 * number, last_s, step_s):
            azimuth, elevation = angles_deg(slot, source_m(time_s))
            stamp = START + np.timedelta64(round((time_s + late_s * number) * 1e6), "us")
            found.append(
                {
                    "timestamp": f"{stamp}Z",
                    "sensor_id": name,
                    "azimuth_deg": azimuth,
                    "elevation_deg": elevation,
                    "line_of_sight_sigma_urad": 20.0,
                }
            )
    return sorted(found, key=lambda row: str(row["timestamp"]))


def answer(folder, capsys, table, *words):
    """Return what `opir track` prints of a table."""
    with (folder / "lines.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    (folder / "sensors.yaml").write_text(SENSORS, encoding="utf-8")
    names = [str(folder / name) for name in ("lines.csv", "sensors.yaml", "events.jsonl")]
    assert main(["track", names[0], "--sensors", names[1], "--out", names[2], *words]) == 0
    printed = capsys.readouterr()
    return printed.err + printed.out


def changed(azimuth=lambda a: a, elevation=lambda e: e):
    return [
        row
        | {
            "azimuth_deg": azimuth(row["azimuth_deg"]),
            "elevation_deg": elevation(row["elevation_deg"]),
        }
        for row in rows()
    ]


def exchanged():
    other = {"WEST": "EAST", "EAST": "WEST"}
    return [row | {"sensor_id": other[row["sensor_id"]]} for row in rows()]


SLIPS = {
    "from south": (
        changed(lambda a: (a + 180.0) % 360.0),
        "with azimuths from south (--columns azimuth_from_south_deg=NAME)",
    ),
    "to the west": (
        changed(lambda a: -a % 360.0),
        "with azimuths counted to the west (change the sign of azimuths)",
    ),
    "from east": (
        changed(lambda a: (90.0 - a) % 360.0),
        "with azimuths from east, counted to the north (give 90° less them)",
    ),
    "exchanged": (
        exchanged(),
        "with the sensors' ids exchanged (--rename WEST=EAST --rename EAST=WEST)",
    ),
    "another clock": (
        rows(late_s=37.0, last_s=60.0),
        "with the second's times 37 s earlier (mend the clock of EAST)",
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_slips_of_lines_are_named(tmp_path, capsys, slip):
    table, words = SLIPS[slip]
    text = answer(tmp_path, capsys, table)
    assert "lines of WEST and EAST within 0.5 s pass each other at" in text
    assert words in " ".join(text.split())


def test_lines_that_meet_are_taken_without_a_word(tmp_path, capsys):
    text = answer(tmp_path, capsys, rows())
    assert "pass each other" not in text
    assert "warning" not in text
    assert "no track" not in text


def test_sensors_that_see_different_sources_have_made_no_slip(tmp_path, capsys):
    table = rows()
    for row in table:
        if row["sensor_id"] == "EAST":
            row["azimuth_deg"], row["elevation_deg"] = angles_deg(
                -75.0, 6.4e6 * np.array([0.4, -0.9, 0.17])
            )
    assert "pass each other" not in answer(tmp_path, capsys, table)


@pytest.mark.parametrize("unit", [1e-6, 1e3])
def test_standard_deviations_that_no_sensor_has_are_named(tmp_path, capsys, unit):
    table = [row | {"line_of_sight_sigma_urad": 20.0 * unit} for row in rows()]
    text = answer(tmp_path, capsys, table)
    assert (
        f"the standard deviation of WEST, {20.0 * unit:.3g} µrad, is outside of 0.1 to 10000 µrad"
        in text
    )


def test_whole_seconds_are_the_reason_for_no_track(tmp_path, capsys):
    table = [row | {"timestamp": f"{str(row['timestamp'])[:19]}Z"} for row in rows(step_s=0.125)]
    text = answer(tmp_path, capsys, table, "--set", "sensors[*].scan_period_ms=100")
    assert "no track from 319 detections: 160 of 160 lines of WEST share 20 whole seconds" in text
    assert "give times with more decimals" in text


def test_few_scans_are_the_reason_for_no_track(tmp_path, capsys):
    text = answer(tmp_path, capsys, rows(last_s=2.0))
    assert "WEST has 2 detections, and a track takes 4 scans" in text


def test_lines_rarer_than_scans_are_named(tmp_path, capsys):
    text = answer(tmp_path, capsys, rows(step_s=4.0, last_s=60.0))
    assert "lines of WEST are 4 s apart in the median, and its scans in the scene 1 s" in text
    assert "of which those between count as misses" in text
    assert "set scan_period_ms: 4000" in text


def test_lines_rarer_than_scans_are_the_reason_for_no_track(tmp_path, capsys):
    west = [row for row in rows(step_s=10.0, last_s=120.0) if row["sensor_id"] == "WEST"]
    text = answer(tmp_path, capsys, west)
    assert "no track from 12 detections: lines of WEST are 10 s apart in the median" in text
    assert "no common motion" not in text


def test_a_line_at_the_end_of_the_scene_begins_no_track(tmp_path, capsys) -> None:
    text = answer(tmp_path, capsys, rows(last_s=0.1)[:1])
    assert "WEST has 1 detection, and a track takes 4 scans" in text


def test_sensors_at_one_place_show_no_slip():
    """Two sensors of one satellite in a low orbit see a source that stays."""
    time_s = np.arange(0.0, 60.0)
    phase = 1e-3 * time_s[:, None]
    origin = 7.4e6 * (np.cos(phase) * [1.0, 0.0, 0.0] + np.sin(phase) * [0.0, 0.5, 0.8660254])
    offset = [6.3e6, 0.8e6, 0.6e6] - origin
    direction = offset / np.linalg.norm(offset, axis=1)[:, None]
    lines = Lines(time_s, origin, direction, np.full(60, 20e-6))
    assert not list(slips_of_pair((lines, lines), ("ONE", "TWO")))
