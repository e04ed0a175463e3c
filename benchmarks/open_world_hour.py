"""An hour of fires, gas flares, glints and false alarms before three constellations, and a few
launches among them.
"""

import time
from typing import Any

import numpy as np
from figures import keep
from opir_scoring.evidence import true_states_ecef

import opir_core as opir

#: A track claims a launch above this, and has recognised one above that.
LAUNCHED = 0.5
KNOWN = 0.95

#: Types of the launches.
LAUNCHES = 3 * ("SRBM", "IRBM", "ICBM", "SLV")

#: Ground sources for a launch, by the default prior rates.
GROUND_SOURCES = 1000.0


def hour_scene(duration_s: float, seed: int) -> opir.Scene:
    """Return fires, flares, a glint and false alarms before three constellations, and a few
    launches.
    """
    region = {"south_deg": 30, "north_deg": 45, "west_deg": 40, "east_deg": 80}
    rng = np.random.default_rng([17, seed])
    targets = []
    for number, kind in enumerate(LAUNCHES):
        launch = {"lat_deg": rng.uniform(31, 44), "lon_deg": rng.uniform(42, 78)}
        launch["time_s"] = duration_s * (number + 0.5) / (len(LAUNCHES) + 1.0)
        target: dict[str, Any] = {"id": f"{kind}-{number}", "type": kind, "launch": launch}
        reach = {"SRBM": 4.0, "IRBM": 25.0, "ICBM": 70.0}.get(kind)
        if reach is None:
            target["azimuth_deg"] = 70.0
        else:
            target["aim"] = {
                "lat_deg": launch["lat_deg"] - 0.3 * reach,
                "lon_deg": launch["lon_deg"] + reach,
            }
        targets.append(target)
    return opir.scene_from_mapping(
        {
            "scene": "hour",
            "epoch": "2026-04-01T03:00:00Z",
            "duration_s": duration_s,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": "S1", "orbital_slot_deg": 40.0},
                {"model": "DSP", "id": "D1", "orbital_slot_deg": 70.0},
                {"model": "NEXTGEN-GEO", "id": "N1", "orbital_slot_deg": 90.0},
            ],
            "targets": targets,
            "detection": "snr",
            "classification": "spectral",
            "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
            "background": "earth",
            "tracker": "imm",
            "sources": [
                {
                    "id": "fires",
                    "model": "fires",
                    "field": {"region": region, "per_million_km2": 8},
                },
                {
                    "id": "flares",
                    "model": "flares",
                    "field": {"region": region, "per_million_km2": 4},
                },
                {"id": "sea", "model": "glints", "at": [{"lat_deg": 20.0, "lon_deg": 65.0}]},
            ],
        }
    )


class Watched:
    """What windows of a run showed: detections of targets by track, of launches early on, and
    claims of launches.
    """

    def __init__(self, plan: opir.Plan) -> None:
        self.early_s = plan.targets.ignition_s[: len(plan.scene.targets)] + 60.0
        self.seen: dict[int, dict[int, int]] = {}
        self.early = [opir.Detections.empty() for _ in self.early_s]
        self.claims: dict[int, float] = {}
        self.known_s: dict[int, float] = {}
        self.tracks: set[int] = set()

    def add(self, window: opir.Window) -> None:
        """Add a window."""
        found = window.detections
        rows = window.tracks
        target = window.truth.target
        for one, track in zip(target.tolist(), found.track.tolist(), strict=True):
            if track >= 0:
                counts = self.seen.setdefault(track, {})
                counts[one] = counts.get(one, 0) + 1
        for one, until_s in enumerate(self.early_s.tolist()):
            mine = found.take(np.flatnonzero((target == one) & (found.time_s < until_s)))
            self.early[one] = opir.Detections.concatenate([self.early[one], mine])
        self.tracks |= set(rows.track.tolist())
        columns = (rows.track, rows.tick_s, rows.probability_launch)
        for track, when_s, chance in zip(*(column.tolist() for column in columns), strict=True):
            if chance > LAUNCHED:
                self.claims[track] = max(self.claims.get(track, 0.0), chance)
            if chance > KNOWN:
                self.known_s.setdefault(track, when_s)

    @property
    def target_of(self) -> dict[int, int]:
        """The target, -1 for noise, that gave each track most of its detections."""
        return {
            track: max(counts, key=lambda one: counts[one]) for track, counts in self.seen.items()
        }


def closed_form_s(plan: opir.Plan, target: int, looks: opir.Detections) -> float:
    """Return the time since ignition at which the detections of a target tell it from a fire by its
    motion alone, s.

    That of the page on hypotheses, for the true motion: half of the squared motion across the lines
    of sight about its mean, in units of their errors, is as large as the prior needs.
    """
    begin = float(plan.targets.ignition_s[target])
    looks = looks.take(np.argsort(looks.time_s, kind="stable"))
    state = true_states_ecef(
        plan, np.full(len(looks), target, dtype=np.int32), np.maximum(looks.time_s, begin + 1e-6)
    )
    apart = state[:, :3] - looks.sensor_ecef_m
    far = np.linalg.norm(apart, axis=1)
    moved = state[:, :3] - state[0, :3]
    across = moved - apart * (np.sum(moved * apart, axis=1) / far**2)[:, None]
    ratio = np.zeros(len(looks))
    for sensor in np.unique(looks.sensor):
        mine = looks.sensor == sensor
        weight = np.where(mine, (looks.line_of_sight_sigma_rad * far) ** -2.0, 0.0)
        whole = np.maximum(np.cumsum(weight), 1e-300)
        first = np.cumsum(weight[:, None] * across, axis=0)
        second = np.cumsum(weight * np.sum(across**2, axis=1))
        ratio += 0.5 * (second - np.sum(first**2, axis=1) / whole)
    enough = ratio > np.log(KNOWN / (1.0 - KNOWN) * GROUND_SOURCES)
    return float(looks.time_s[np.argmax(enough)]) - begin if enough.any() else np.nan


def hour(duration_s: float, seed: int) -> list[str]:
    """Return the lines about fires for a time: tracks that claim a launch, and when launches are
    recognised.
    """
    plan = opir.compile_plan(hour_scene(duration_s, seed))
    watched = Watched(plan)
    clock = time.process_time()
    wall = time.perf_counter()
    for window in opir.plan_windows(plan):
        watched.add(window)
    cost_s = time.process_time() - clock
    wall_s = time.perf_counter() - wall
    launches = len(plan.scene.targets)
    of = watched.target_of
    false = [track for track in watched.claims if not 0 <= of.get(track, -1) < launches]
    keep("false launches", len(false))
    times = list[str]()
    for target in range(launches):
        after = [when_s for track, when_s in watched.known_s.items() if of.get(track) == target]
        if after:
            took_s = min(after) - float(plan.targets.ignition_s[target])
            looks = watched.early[target]
            first_s = float(looks.time_s.min() - plan.targets.ignition_s[target])
            least_s = closed_form_s(plan, target, looks)
            times.append(
                f"| {plan.targets.ids[target]} | {first_s:.1f} | {took_s:.1f} | {least_s:.1f}"
                f" | {took_s / least_s:.2f} |"
            )
    scene = (
        f"{duration_s:g} s, seed {seed}: {len(watched.tracks)} tracks of {len(plan.targets.ids)}"
        f" targets and sources"
    )
    pace = f"{duration_s / cost_s:.0f} × real time; {wall_s:.0f} s on the clock"
    return [
        "\n## Fires and launches among them\n",
        f"{scene}; {len(false)} claimed a launch falsely (P > {LAUNCHED}).",
        f"It took {cost_s:.0f} s of processor time ({pace}).\n",
        f"| launch | first detection, s | P(launch) > {KNOWN}, s | closed form, s | ratio |",
        "|---|---|---|---|---|",
        *times,
    ]
