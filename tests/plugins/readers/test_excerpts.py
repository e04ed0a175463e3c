"""`opir track` on a part of a burn: the end of a file is no end of a burn."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import main
from drawn_flights import SLOTS_RAD, Flown, Seeing, flown, seen
from track_lines import whole_records

from opir_core import load_run

FLIGHTS = 4

#: Where the flights are cut off, as shares of their burns.
CUTS = (0.4, 0.8)

#: Looks of SBIRS-GEO that scan every 0.5 s.
LOOKS = Seeing(period_s=0.5, sigma_rad=20e-6, chance=0.8)

SENSORS = "sensors:\n" + "".join(
    f"  - {{model: SBIRS-GEO, id: S{number}, orbital_slot_deg: {np.degrees(slot):.9f},"
    f" scan_period_ms: 500}}\n"
    for number, slot in enumerate(SLOTS_RAD)
)
WORDS = ["--set", "epoch=2026-04-01T12:00:00Z"]


@pytest.fixture(scope="module")
def flights() -> Flown:
    return flown("ICBM", FLIGHTS, 57, "staged")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, flights: Flown) -> Path:
    """Return a folder with the sensors, and the lines of sight of each burn as `0.csv` to
    `3.csv`.
    """
    where = tmp_path_factory.mktemp("burns")
    (where / "sensors.yaml").write_text(SENSORS)
    owner, rays = seen(flights, LOOKS, 57)
    for flight in range(FLIGHTS):
        sights = rays.take(np.flatnonzero(owner == flight))
        columns = (sights.time_s, sights.sensor, *sights.direction_ecef.T, sights.sigma_rad * 1e6)
        rows = [
            f"{row[0]:.9f},S{row[1]},{row[2]:.12f},{row[3]:.12f},{row[4]:.12f},{row[5]}"
            for row in zip(*columns, strict=True)
        ]
        head = "time_s,sensor_id,los_x_ecef,los_y_ecef,los_z_ecef,line_of_sight_sigma_urad"
        (where / f"{flight}.csv").write_text("\n".join([head, *rows, ""]))
    return where


def excerpt(folder: Path, flight: int, cut_s: float) -> tuple[Path, float]:
    """Return a file with the lines of a burn up to a time, and the time of the last."""
    head, *lines = (folder / f"{flight}.csv").read_text().splitlines()
    selected = [line for line in lines if float(line.split(",")[0]) <= cut_s]
    path = folder / f"{flight}-{cut_s:.0f}.csv"
    path.write_text("\n".join([head, *selected, ""]))
    return path, float(selected[-1].split(",")[0])


def tracked(path: Path, *words: str) -> dict[str, Any]:
    """Return the last record of the only launch in a file."""
    out = path.with_suffix(".jsonl")
    sensors = str(path.parent / "sensors.yaml")
    assert (
        main(["track", str(path), "--sensors", sensors, "--out", str(out), "-q", *WORDS, *words])
        == 0
    )
    records = whole_records(out.with_suffix(".tracks.jsonl"))
    (final,) = [record for record in records if record["time_s"] == records[-1]["time_s"]]
    return final


def is_inside(path: Path, place: Any) -> bool:
    """Return whether the impact is in a 95 % region of the last record, whatever that presumes."""
    regions = load_run(path.with_suffix(".jsonl")).tracks.impact_regions[-1]
    return any(region.contains(*place) for region in regions if region.containment == 0.95)


def test_a_scene_without_an_end_ends_with_the_last_line(folder: Path, flights: Flown) -> None:
    path, last_s = excerpt(folder, 0, 8.3)
    assert tracked(path)["time_s"] == last_s
    scene = json.loads(path.with_suffix(".manifest.json").read_text())["scene"]
    assert scene["duration_s"] == last_s


def test_a_scene_that_goes_on_ends_with_the_last_line_too(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, last_s = excerpt(folder, 0, 8.3)
    expected = tracked(path)
    (folder / "longer.yaml").write_text(f"duration_s: 300\n{SENSORS}")
    command = ["track", str(path), "--sensors", str(folder / "longer.yaml"), *WORDS]
    assert main([*command, "--out", str(path) + "l"]) == 0
    out = capsys.readouterr().out
    assert f"as of {last_s:.1f} s" in out
    assert f"–{last_s:.1f} s; " in out
    assert "before and after that nothing is known (by first and last lines, and gaps)" in out
    (folder / "sensors.yaml").write_text(SENSORS)
    assert tracked(path) == expected


@pytest.mark.slow
def test_an_excerpt_says_what_a_run_says_that_ends_there(folder: Path, flights: Flown) -> None:
    for flight, share in enumerate((0.2, 0.4, 0.6, 0.9)):
        path, last_s = excerpt(
            folder, flight, float(flights.start_s[flight] + share * flights.burn_s[flight])
        )
        expected = tracked(folder / f"{flight}.csv", "--set", f"duration_s={last_s!r}")
        assert tracked(path) == expected


@pytest.mark.slow
def test_regions_of_excerpts_contain_the_impact(folder: Path, flights: Flown) -> None:
    impacts = flights.impacts()
    held = []
    for flight in range(FLIGHTS):
        for share in CUTS:
            path, _ = excerpt(
                folder, flight, float(flights.start_s[flight] + share * flights.burn_s[flight])
            )
            tracked(path)
            held.append(is_inside(path, impacts[flight, :2]))
    # Of 8 regions that contain it with 95 % fewer than 6 do so in 0.6 % of all draws.
    assert sum(held) >= 6, held
