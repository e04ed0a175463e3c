"""How often is what is no launch taken for one? Groups of flares, flashes, fires on high ground,
jets on afterburner; and how soon are launches recognised, alone and among flares?

Each kind is drawn with seeds of its own before two or three SBIRS-GEO with default settings. A
track claims a launch falsely if P(launch) exceeds 0.5 at any tick; it keeps a launch point if its
last row has one.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from figures import keep
from foreign_flights import drawn_flight
from one_flight import flight_scene, table_target, write_table

import opir_core as opir
from opir_core.geometry import geodetic_to_ecef, local_axes

#: A track claims a launch above this, and has recognised one above that.
CLAIM = 0.5
KNOWN = 0.95
SLOTS_DEG = (10.0, 80.0, 45.0)
#: Metres of a degree of latitude.
DEGREE_M = 111.2e3


def scene_of(sources, targets, duration_s, seed, sensors=2, **settings):
    """Return a scene of sources and targets before geostationary sensors."""
    return opir.scene_from_mapping(
        {
            "scene": "no-launch",
            "epoch": "2026-04-01T20:00:00Z",
            "duration_s": duration_s,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{number}", "orbital_slot_deg": slot_deg}
                for number, slot_deg in enumerate(SLOTS_DEG[:sensors])
            ],
            "targets": targets,
            "detection": "snr",
            "tracker": "imm",
            "sources": [{"id": "lights", "model": "flares", "at": sources}] if sources else [],
            **settings,
        }
    )


def places(count, rng):
    """Return latitudes and longitudes, degrees, in view of all sensors, at least 2° apart."""
    grid = [(lat, lon) for lat in range(-20, 21, 2) for lon in range(30, 61, 2)]
    rows = rng.choice(len(grid), count, replace=False)
    return [tuple(np.array(grid[row], dtype=float) + rng.uniform(-0.3, 0.3, 2)) for row in rows]


def flare_group(place, rng, size=None, half_km=None):
    """Return a group of flares within a square."""
    size = int(rng.integers(2, 9)) if size is None else size
    half_km = np.exp(rng.uniform(np.log(0.3), np.log(6.0))) if half_km is None else half_km
    offsets_deg = rng.uniform(-half_km, half_km, (size, 2)) * 1e3 / DEGREE_M
    return [
        {
            "lat_deg": float(place[0] + north),
            "lon_deg": float(place[1] + east / np.cos(np.radians(place[0]))),
            "area_m2": 200.0,
        }
        for north, east in offsets_deg
    ]


def groups(count, rng):
    """Return flares in groups of two to eight within 0.3 to 6 km."""
    return [flare for place in places(count, rng) for flare in flare_group(place, rng)]


def gulf(count, rng):
    """Return flares, half of them in groups of five."""
    centres = [(rng.uniform(20, 30), rng.uniform(45, 55)) for _ in range(count // 10)]
    flares = [flare for centre in centres for flare in flare_group(centre, rng, 5)]
    alone = [(rng.uniform(20, 30), rng.uniform(45, 55)) for _ in range(count - len(flares))]
    return flares + [{"lat_deg": lat, "lon_deg": lon, "area_m2": 200.0} for lat, lon in alone]


def flashes(count, rng, duration_s):
    """Return flashes of 0.15 to 0.7 s at 6 to 14 km."""
    lights = []
    for latitude, longitude in places(count, rng):
        start_s = rng.uniform(3.0, duration_s - 10.0)
        lights.append(
            {
                "lat_deg": float(latitude),
                "lon_deg": float(longitude),
                "start_s": float(start_s),
                "end_s": float(start_s + rng.uniform(0.15, 0.7)),
                "height_m": float(rng.uniform(6e3, 14e3)),
                "temperature_k": 15e3,
                "area_m2": 20.0,
            }
        )
    return lights


def high_fires(count, rng):
    """Return fires on ground up to 6 km high."""
    return [
        {
            "lat_deg": float(latitude),
            "lon_deg": float(longitude),
            "height_m": float(rng.uniform(0.0, 6e3)),
            "area_m2": 200.0,
        }
        for latitude, longitude in places(count, rng)
    ]


def jet_path(kind, rng, place, duration_s):
    """Return rows (n, 8) of the flight of a jet on afterburner: climbing, level, turning or taking
    off.
    """
    times_s = np.arange(0.0, duration_s + 0.5, 1.0)
    speed_m_s = rng.uniform(220.0, 420.0)
    gain_m_s2 = rng.uniform(0.0, 1.0)
    climb_rad = np.radians(rng.uniform(8.0, 25.0)) if kind == "climb" else 0.0
    turn_rad_s = rng.uniform(0.02, 0.06) if kind == "turn" else 0.0
    height_m = rng.uniform(2e3, 10e3)
    if kind == "take-off":
        speed_m_s, gain_m_s2, height_m = 20.0, rng.uniform(4.0, 6.0), 100.0
    speeds = np.minimum(speed_m_s + gain_m_s2 * times_s, 450.0)
    climbs = np.full(len(times_s), climb_rad)
    if kind == "take-off":
        climbs = np.where(speeds > 90.0, np.radians(12.0), 0.0)
    course = rng.uniform(0.0, 2.0 * np.pi) + turn_rad_s * times_s
    velocity = speeds[:, None] * np.column_stack(
        [np.cos(climbs) * np.sin(course), np.cos(climbs) * np.cos(course), np.sin(climbs)]
    )
    return _flown(times_s, velocity, place, height_m)


def _flown(times_s, velocity, place, height_m, follows=True):
    """Return rows (n, 8) of velocities (n, 3), east, north and up, from a place at a height; what
    flies level `follows` the ground.
    """
    step = 0.5 * (velocity[1:] + velocity[:-1])
    local = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    latitude, longitude = np.radians(place)
    origin = geodetic_to_ecef(np.array(latitude), np.array(longitude), np.array(height_m))
    axes = local_axes(origin[None])[0]
    position = origin + local @ axes
    if follows:
        rise = np.sum(local[:, :2] ** 2, axis=1) / (2.0 * np.linalg.norm(origin))
        position = position - rise[:, None] * axes[2]
    burning = np.ones((len(times_s), 1))
    return np.column_stack([times_s, position, velocity @ axes, burning])


JETS = ("climb", "level", "turn", "take-off")

#: Bodies in level flight or on a straight descent: least and most height, m, speed, m/s, descent, °,
#: and time, s.
BODIES = {
    "grazer": ((60e3, 90e3), (11e3, 16e3), (-0.5, 0.5), 20.0),
    "re-entry": ((75e3, 95e3), (7e3, 7.8e3), (0.5, 3.0), 60.0),
    "cruise": ((50.0, 500.0), (200.0, 280.0), (0.0, 0.0), 70.0),
    "helicopter": ((50.0, 2e3), (40.0, 80.0), (0.0, 0.0), 70.0),
    "train": ((0.0, 800.0), (15.0, 60.0), (0.0, 0.0), 70.0),
}


def body_path(kind, rng, place):
    """Return rows (n, 8) of a straight flight."""
    heights, speeds, descents, duration_s = BODIES[kind]
    times_s = np.arange(0.0, duration_s + 0.5, 1.0)
    speed_m_s = rng.uniform(*speeds)
    descent = np.radians(rng.uniform(*descents))
    course = rng.uniform(0.0, 2.0 * np.pi)
    level = speed_m_s * np.cos(descent)
    aim = [level * np.sin(course), level * np.cos(course), -speed_m_s * np.sin(descent)]
    velocity = np.tile(aim, (len(times_s), 1))
    return _flown(
        times_s, velocity, place, rng.uniform(*heights), follows=kind not in ("grazer", "re-entry")
    )


def jets(count, rng, folder, duration_s, kinds=JETS):
    """Return targets that fly as jets do."""
    targets = []
    for number, place in enumerate(places(count, rng)):
        path = Path(folder) / f"jet{number}.csv"
        kind = kinds[number % len(kinds)]
        rows = (
            body_path(kind, rng, place)
            if kind in BODIES
            else jet_path(kind, rng, place, duration_s - 8.0)
        )
        write_table(path, rows)
        target = {**table_target(path, "SRBM"), "id": f"{kind}-{number}", "start_s": 4.0}
        targets.append(target)
    return targets


def watched(scene):
    """Return figures of each track of a run by number, and the processor time, s."""
    plan = opir.compile_plan(scene)
    tracks = {}
    cost_s = 0.0
    start_s = time.process_time()
    for window in opir.plan_windows(plan):
        rows = window.tracks
        for row in range(len(rows.track)):
            known = tracks.setdefault(
                int(rows.track[row]), {"ticks": 0, "over": 0, "most": 0.0, "known_s": np.nan}
            )
            probability = float(rows.probability_launch[row])
            known["ticks"] += 1
            known["over"] += probability > CLAIM
            known["most"] = max(known["most"], probability)
            if probability > KNOWN and np.isnan(known["known_s"]):
                known["known_s"] = float(rows.tick_s[row])
            known["last"] = probability
            known["state"] = rows.state[row]
            known["has_launch"] = bool(np.isfinite(rows.launch[row]).all())
            known["launch"] = rows.launch[row].tolist()
    cost_s = time.process_time() - start_s
    return tracks, cost_s, plan


def summary(name, count, scene):
    """Print and return the figures of what should be no launch."""
    tracks, cost_s, _ = watched(scene)
    values = list(tracks.values())
    figures = {
        "case": name,
        "sources": count,
        "tracks": len(values),
        "claims": sum(track["over"] > 0 for track in values),
        "claim_ticks": sum(track["over"] for track in values),
        "at_the_end": sum(track["last"] > CLAIM for track in values),
        "launch_points": sum(track["has_launch"] for track in values),
        "one_tick": sum(track["ticks"] == 1 for track in values),
        "processor_s": round(cost_s, 1),
    }
    print(json.dumps(figures), flush=True)
    for key, value in figures.items():
        if key != "case":
            keep(f"{name}: {key}", value)
    return figures


def clear_launch(number, seed, folder):
    """Print when a staged gravity turn is recognised, s after ignition."""
    rng = np.random.default_rng([seed, number])
    turn = drawn_flight(1 + number % 3, True, rng)
    path = Path(folder) / f"flight{number}.csv"
    write_table(path, turn.table[turn.table[:, 0] <= 120.0])
    longitude_deg = float(np.degrees(turn.boost.launch[1]))
    scene = flight_scene(table_target(path, "ICBM"), longitude_deg, 85.0, seed + number)
    return recognised_s(scene, 10.0)


def recognised_s(scene, start_s):
    """Return when a track is first known to be a launch, s after ignition."""
    tracks, _, _ = watched(scene)
    known = [track["known_s"] for track in tracks.values() if track["over"]]
    return min(known, default=np.nan) - start_s


def real_launch(path, seed):
    """Return when a real ascent is recognised, s after ignition."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    longitude_deg = float(np.degrees(np.arctan2(rows[0, 2], rows[0, 1])))
    scene = flight_scene(table_target(path, "SLV"), longitude_deg, 85.0, seed)
    return recognised_s(scene, 10.0)


def launch_among_flares(size, half_km, launches, seed, alone=False):
    """Return when launches from the middle of flares are recognised, s after their ignition."""
    rng = np.random.default_rng([23, seed])
    centre = (10.0, 45.0)
    flares = flare_group(centre, rng, size, half_km)
    sites = flare_group(centre, rng, launches, half_km * 0.5)
    targets = [
        {
            "id": f"L{number}",
            "type": "SRBM",
            "launch": {
                "lat_deg": site["lat_deg"],
                "lon_deg": site["lon_deg"],
                "time_s": float(20.0 + (0.0 if launches == 1 else rng.uniform(0.0, 3.0))),
            },
            "aim": {"lat_deg": 12.5, "lon_deg": 46.0},
        }
        for number, site in enumerate(sites)
    ]
    scene = scene_of([] if alone else flares, targets, 75.0, seed)
    tracks, _, _ = watched(scene)
    known_s = sorted(
        track["known_s"] - 20.0
        for track in tracks.values()
        if track["last"] > CLAIM and np.linalg.norm(track["state"][3:]) > 300.0
    )
    claims = sum(track["over"] > 0 for track in tracks.values())
    return known_s, claims


def drawn_scene(case, options, folder):
    """Return the scene of a case without launches."""
    seed, count, sensors = options.seed, options.count, options.sensors
    rng = np.random.default_rng([seed, sum(map(ord, case))])
    if case in (*JETS, *BODIES, "jets"):
        kinds = JETS if case == "jets" else (case,)
        return scene_of([], jets(count, rng, folder, 80.0, kinds), 80.0, seed, sensors)
    if case == "flashes":
        air = {"atmosphere": {"model": "lowtran", "climate": "tropical"}}
        lights = flashes(count, rng, 70.0)
        return scene_of(lights, [], 70.0, seed, sensors, background="earth", **air)
    lights = {"groups": groups, "gulf": gulf, "fires": high_fires}[case](count, rng)
    return scene_of(lights, [], 40.0 if case == "gulf" else 70.0, seed, sensors)


def launch_cases(case, options, folder):
    """Yield what a case with launches shows."""
    seed, count = options.seed, options.count
    if case == "clear":
        yield [round(clear_launch(number, seed, folder), 1) for number in range(count)]
    elif case == "real":
        paths = sorted(Path(options.flights).glob("*.csv"))
        yield [round(real_launch(path, seed), 1) for path in paths]
    elif case == "among":
        for number in range(count):
            yield [launch_among_flares(10, 3.0, 1, seed + number, alone) for alone in (False, True)]
    else:
        yield [launch_among_flares(50, 12.0, 12, seed, alone) for alone in (False, True)]


def main():
    """Run the cases that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="+")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=16)
    parser.add_argument("--sensors", type=int, default=2)
    parser.add_argument("--flights", default=None, help="folder of tables of real ascents")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for case in options.cases:
            if case in ("clear", "real", "among", "salvo"):
                for row in launch_cases(case, options, folder):
                    print(case, row, flush=True)
            else:
                summary(case, options.count, drawn_scene(case, options, folder))


if __name__ == "__main__":
    main()
