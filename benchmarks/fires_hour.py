"""Fires, gas flares, glints and false alarms before three constellations, and a few launches among
them: tracks that claim a launch, and times until launches are recognised.
"""

import time

import numpy as np
from figures import keep
from opir_scoring.evidence import true_states_ecef
from pages import markdown_table

import opir_core as opir

#: A track claims a launch above this, and has recognised one above that.
LAUNCHED = 0.5
KNOWN = 0.95
#: Types of the launches.
LAUNCHES = 3 * ("SRBM", "IRBM", "ICBM", "SLV")
#: Ground sources for a launch, by the default prior rates.
GROUND_SOURCES = 1000.0

TEXT = """
## Fires and launches among them

{duration_s:g} s, seed {seed}: {tracks} tracks of {sources} targets and sources; {false} claimed a
launch falsely (P > {launched}). It took {processor_s:.0f} s of processor time ({pace:.0f} × real
time).

{table}

15° by 40° of land with 8 fires and 4 gas flares per million km², glints, noise and twelve
launches, before SBIRS-GEO, DSP and NEXTGEN-GEO, with `detection: snr` and `classification:
spectral`. Times are since ignition; the closed form is that of [what is
it?](../explanation/hypotheses.md) for the detections and motion of each launch. Data:
[open_world_fires.csv](open_world_fires.csv).
"""
HEAD = ("launch", "first detection, s", f"P(launch) > {KNOWN}, s", "closed form, s", "ratio")


def launch_targets(duration_s, rng):
    """Return launches from the region, spread over the time."""
    targets = []
    for number, kind in enumerate(LAUNCHES):
        launch = {"lat_deg": rng.uniform(31, 44), "lon_deg": rng.uniform(42, 78)}
        launch["time_s"] = duration_s * (number + 0.5) / (len(LAUNCHES) + 1.0)
        target = {"id": f"{kind}-{number}", "type": kind, "launch": launch}
        reach_deg = {"SRBM": 4.0, "IRBM": 25.0, "ICBM": 70.0}.get(kind)
        if reach_deg is None:
            target["azimuth_deg"] = 70.0
        else:
            latitude_deg = launch["lat_deg"] - 0.3 * reach_deg
            target["aim"] = {"lat_deg": latitude_deg, "lon_deg": launch["lon_deg"] + reach_deg}
        targets.append(target)
    return targets


def hour_scene(duration_s, seed):
    """Return the scene."""
    region = {"south_deg": 30, "north_deg": 45, "west_deg": 40, "east_deg": 80}
    slots_deg = {"SBIRS-GEO": 40.0, "DSP": 70.0, "NEXTGEN-GEO": 90.0}
    counts = {"fires": 8, "flares": 4}
    return opir.scene_from_mapping(
        {
            "scene": "hour",
            "epoch": "2026-04-01T03:00:00Z",
            "duration_s": duration_s,
            "seed": seed,
            "sensors": [
                {"model": model, "id": model, "orbital_slot_deg": slot_deg}
                for model, slot_deg in slots_deg.items()
            ],
            "targets": launch_targets(duration_s, np.random.default_rng([17, seed])),
            "detection": "snr",
            "classification": "spectral",
            "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
            "background": "earth",
            "tracker": "imm",
            "sources": [
                *(
                    {"id": model, "model": model, "field": {"region": region, "per_million_km2": n}}
                    for model, n in counts.items()
                ),
                {"id": "sea", "model": "glints", "at": [{"lat_deg": 20.0, "lon_deg": 65.0}]},
            ],
        }
    )


class Watched:
    """Events of a run: detections of targets by track, of launches early on, and claims of
    launches.
    """

    def __init__(self, plan):
        self.early_s = plan.targets.ignition_s[: len(plan.scene.targets)] + 60.0
        self.early = [opir.Detections.empty() for _ in self.early_s]
        self.counts = {}
        self.claimed = set()
        self.known_s = {}
        self.tracks = set()

    def add(self, window):
        """Add a window."""
        detections = window.detections
        target = window.truth.target
        for number, track in zip(target.tolist(), detections.track.tolist(), strict=True):
            if track >= 0:
                counts = self.counts.setdefault(track, {})
                counts[number] = counts.get(number, 0) + 1
        for number, until_s in enumerate(self.early_s.tolist()):
            rows = np.flatnonzero((target == number) & (detections.time_s < until_s))
            parts = [self.early[number], detections.take(rows)]
            self.early[number] = opir.Detections.concatenate(parts)
        tracks = window.tracks
        self.tracks |= set(tracks.track.tolist())
        self.claimed |= set(tracks.track[tracks.probability_launch > LAUNCHED].tolist())
        for row in np.flatnonzero(tracks.probability_launch > KNOWN).tolist():
            self.known_s.setdefault(int(tracks.track[row]), float(tracks.tick_s[row]))

    def target_of(self, track):
        """Return the target, -1 for noise, that gave a track most of its detections."""
        counts = self.counts.get(track, {-1: 1})
        return max(counts, key=counts.__getitem__)


def closed_form_s(plan, target, looks):
    """Return the time since ignition at which the detections of a target distinguish it from a fire
    by its motion alone, s.

    That of the page on hypotheses, for the true motion: half of the squared motion across the lines
    of sight about its mean, in units of their errors, is as large as the prior needs.
    """
    ignition_s = float(plan.targets.ignition_s[target])
    looks = looks.take(np.argsort(looks.time_s, kind="stable"))
    number = np.full(len(looks), target, dtype=np.int32)
    state = true_states_ecef(plan, number, np.maximum(looks.time_s, ignition_s + 1e-6))
    line = state[:, :3] - looks.sensor_ecef_m
    range_m = np.linalg.norm(line, axis=1)
    moved = state[:, :3] - state[0, :3]
    across = moved - line * (np.sum(moved * line, axis=1) / range_m**2)[:, None]
    ratio = np.zeros(len(looks))
    for sensor in np.unique(looks.sensor):
        sigma_m = looks.line_of_sight_sigma_rad * range_m
        weight = np.where(looks.sensor == sensor, sigma_m**-2.0, 0.0)
        total = np.maximum(np.cumsum(weight), 1e-300)
        first = np.cumsum(weight[:, None] * across, axis=0)
        second = np.cumsum(weight * np.sum(across**2, axis=1))
        ratio += 0.5 * (second - np.sum(first**2, axis=1) / total)
    enough = ratio > np.log(KNOWN / (1.0 - KNOWN) * GROUND_SOURCES)
    return float(looks.time_s[np.argmax(enough)]) - ignition_s if enough.any() else np.nan


def launch_row(plan, watched, target):
    """Return the row of a launch, empty if it is not recognised."""
    times_s = [
        time_s for track, time_s in watched.known_s.items() if watched.target_of(track) == target
    ]
    if not times_s:
        return {}
    looks = watched.early[target]
    ignition_s = float(plan.targets.ignition_s[target])
    return {
        "launch": plan.targets.ids[target],
        "first_detection_s": float(looks.time_s.min()) - ignition_s,
        "recognised_s": min(times_s) - ignition_s,
        "closed_form_s": closed_form_s(plan, target, looks),
    }


def fire_rows(duration_s, seed, facts):
    """Yield the rows of recognised launches among fires; the facts get figures of the whole run."""
    plan = opir.compile_plan(hour_scene(duration_s, seed))
    watched = Watched(plan)
    start_s = time.process_time()
    for window in opir.plan_windows(plan):
        watched.add(window)
    cost_s = time.process_time() - start_s
    launches = len(plan.scene.targets)
    false = [track for track in watched.claimed if not 0 <= watched.target_of(track) < launches]
    keep("false launches", len(false))
    facts |= {
        "fires_duration_s": duration_s,
        "fires_seed": seed,
        "fires_tracks": len(watched.tracks),
        "fires_sources": len(plan.targets.ids),
        "fires_false": len(false),
        "fires_processor_s": cost_s,
    }
    yield from filter(None, (launch_row(plan, watched, target) for target in range(launches)))


def fires_text(facts, launches):
    """Return the part of the page about fires."""
    figures = {
        name.removeprefix("fires_"): value
        for name, value in facts.items()
        if name.startswith("fires_")
    }
    lines = []
    for row in launches:
        times_s = [row["first_detection_s"], row["recognised_s"], row["closed_form_s"]]
        ratio = row["recognised_s"] / row["closed_form_s"]
        lines.append((row["launch"], *(f"{time_s:.1f}" for time_s in times_s), f"{ratio:.1f}"))
    return TEXT.format(
        **figures,
        launched=LAUNCHED,
        pace=figures["duration_s"] / figures["processor_s"],
        table=markdown_table(HEAD, lines),
    )
