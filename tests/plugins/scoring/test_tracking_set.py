"""The tracking set: its generator writes the committed bytes, and its judge ranks trackers as their
errors deserve.
"""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from repository import ROOT

sys.path += [str(ROOT / "benchmarks"), str(ROOT / "benchmarks" / "tracking_set")]
from opir_scoring.benchmark_figures import figures_by_case, scored_set
from opir_scoring.benchmark_tables import COVARIANCE, STATE
from set_bounds import bounds_of, efficient_sigma
from set_cases import CASES, scene_of
from set_files import observed_rows, scene_digest, write_set
from set_flights import burns, flown
from set_sights import observed

from opir_core import SceneError
from opir_core.cli.main import main
from opir_core.orbits import CircularConfig, OrbitConfig, orbit_of

CASE = "clutter"
SEED = 1
HEADER = ("scene", "track", "time_s", *STATE, *COVARIANCE)
SIGMA = np.array([300.0] * 3 + [20.0] * 3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("set")
    write_set(place, [CASE], [SEED])
    return place


def truth_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "truth.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def tracks(folder: Path, name: str, error, sigma=SIGMA, **changes) -> Path:
    """Write tracks that are the truth plus errors (6,) for each row; `changes` replace names of
    launches.
    """
    upper = [f"{value:.9g}" for value in np.diag(np.square(sigma))[np.triu_indices(6)]]
    rows = []
    for number, row in enumerate(truth_of(folder)):
        state = np.array([float(row[key]) for key in STATE]) + error(number)
        track = changes.get(row["launch"], row["launch"])
        if track:
            rows.append(
                [row["scene"], track, row["time_s"], *(f"{value:.4f}" for value in state), *upper]
            )
    path = folder / name
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])
    return path


def figures(folder: Path, path: Path) -> dict:
    return figures_by_case([each for _, each in scored_set(folder, path)[1]])[CASE]


def test_the_generator_writes_the_committed_bytes() -> None:
    selected = json.loads(
        (ROOT / "benchmarks" / "tracking_set" / "digests.json").read_text(encoding="utf-8")
    )
    assert len(selected["scenes"]) == len(CASES) * 2
    scene = scene_of("slow-scanners", 2)
    assert scene_digest(observed_rows(scene, *observed(scene))) == selected["scenes"][scene.name]


def test_a_perfect_tracker_scores_perfectly(folder: Path) -> None:
    result = figures(folder, tracks(folder, "perfect.csv", lambda row: np.zeros(6)))
    assert result["covered"] == 1.0
    assert (result["false_tracks"], result["missed_launches"]) == (0, 0)
    # Files have centimetres.
    assert result["gospa_m"] < 0.05
    assert result["position_median_m"] < 0.05
    assert result["held_95"]["value"] == 1.0


def test_a_shifted_tracker_scores_worse_by_its_shift(folder: Path) -> None:
    shift = np.array([300.0, 400.0, 0.0, 0.0, 0.0, 0.0])
    right = figures(folder, tracks(folder, "right.csv", lambda row: np.zeros(6)))
    result = figures(folder, tracks(folder, "shifted.csv", lambda row: shift))
    assert result["gospa_m"] == pytest.approx(500.0, rel=1e-4)
    assert result["position_median_m"] == pytest.approx(500.0, abs=0.1)
    assert result["nees_over_6_median"] == pytest.approx(
        np.sum(np.square(shift / SIGMA)) / 6.0, rel=1e-3
    )
    assert result["position_energy_m"] > right["position_energy_m"]
    assert result["log_score_above_bound"] > right["log_score_above_bound"]
    assert result["error_over_bound"] > right["error_over_bound"] + 0.3


def test_errors_as_stated_are_consistent(folder: Path) -> None:
    errors = np.random.default_rng(1).normal(size=(len(truth_of(folder)), 6)) * SIGMA
    result = figures(folder, tracks(folder, "stated.csv", lambda row: errors[row]))
    assert result["nees_over_6_median"] == pytest.approx(0.89, abs=0.15)
    assert result["held_95"]["interval_95"][0] < 0.95 <= result["held_95"]["interval_95"][1]
    # A covariance that is too small or too large costs both proper scores.
    for factor in (0.3, 3.0):
        other = figures(
            folder, tracks(folder, "other.csv", lambda row: errors[row], factor * SIGMA)
        )
        assert other["position_energy_m"] > result["position_energy_m"]
        assert other["log_score_above_bound"] > result["log_score_above_bound"]


def test_what_is_missed_doubled_or_false_is_counted(folder: Path) -> None:
    result = figures(folder, tracks(folder, "missed.csv", lambda row: np.zeros(6), L2=""))
    assert (result["false_tracks"], result["missed_launches"]) == (0, 1)
    scored = [row for row in truth_of(folder) if row["is_scored"] == "1"]
    assert result["covered"] == pytest.approx(np.mean([row["launch"] != "L2" for row in scored]))
    # A launch missed among n costs c / √2, over √n.
    ticks = {
        row["time_s"]: {each["launch"] for each in scored if each["time_s"] == row["time_s"]}
        for row in scored
    }
    costs = [("L2" in names) / np.sqrt(2.0 * len(names)) for names in ticks.values()]
    assert result["gospa_m"] == pytest.approx(result["cutoff_m"][0] * np.mean(costs), abs=0.1)
    path = tracks(folder, "double.csv", lambda row: np.zeros(6))
    lines = path.read_text(encoding="utf-8").splitlines()
    repeated = [line.replace(",L1,", ",again,") for line in lines if ",L1," in line]
    away = [
        line.replace(",L1,", ",away,").replace(line.split(",")[3], "6999999.0") for line in repeated
    ]
    path.write_text(
        "\n".join([*lines, *repeated, *(line.replace("again", "away") for line in away)]),
        encoding="utf-8",
    )
    assert figures(folder, path)["false_tracks"] == 2


def test_the_command_scores_csv_json_and_parquet_alike(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tracks(folder, "mine.csv", lambda row: np.full(6, 10.0))
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    path.with_suffix(".json").write_text(json.dumps(rows), encoding="utf-8")
    printed = []
    for ending in (".csv", ".json"):
        assert (
            main(["score", str(folder), "--tracks", str(path.with_suffix(ending)), "--json"]) == 0
        )
        printed.append(json.loads(capsys.readouterr().out)["cases"])
    assert printed[0] == printed[1]
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(arrow.Table.from_pylist(rows), path.with_suffix(".parquet"))
    assert (
        main(["score", str(folder), "--tracks", str(path.with_suffix(".parquet")), "--case", CASE])
        == 0
    )
    assert CASE in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scene,track\n", "has no column time_s"),
        (",".join(HEADER) + "\ncluter-1,1,5" + ",1" * 27 + "\n", "no scene 'cluter-1' in the set"),
        (
            ",".join(HEADER) + f"\n{CASE}-{SEED},1,5,x" + ",1" * 26 + "\n",
            "could not convert string to float: 'x'",
        ),
        (
            ",".join(HEADER) + f"\n{CASE}-{SEED},1,5" + ",-1" * 27 + "\n",
            "a variance is not positive",
        ),
        (",".join(HEADER) + (f"\n{CASE}-{SEED},1,5" + ",1" * 27) * 2 + "\n", "has two rows at 5 s"),
        (",".join(HEADER) + "\na,1\n", "has another number of cells than the header (30)"),
    ],
)
def test_a_wrong_file_of_tracks_is_refused_with_its_place(
    folder: Path, text: str, said: str
) -> None:
    path = folder / "wrong.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(
        SceneError, match=f".*wrong.csv: 1 problem\n.*{said.replace('(', '.').replace(')', '.')}"
    ):
        scored_set(folder, path)


def test_positions_of_sensors_are_those_of_their_orbits() -> None:
    for sensor in scene_of("high-and-low", 1).sensors:
        orbit = CircularConfig(
            altitude_km=1e-3 * sensor.altitude_m,
            inclination_deg=sensor.inclination_deg,
            lon_asc_node_deg=sensor.node_deg,
            arg_latitude_deg=sensor.argument_deg,
        )
        time_s = np.array([0.0, 100.0, 250.0])
        there = orbit_of(OrbitConfig(circular=orbit), 1_767_225_600_000_000).position_ecef_m(time_s)
        np.testing.assert_allclose(sensor.position_m(time_s), there, atol=0.1)


def test_known_thrust_lowers_the_bound() -> None:
    scene = scene_of("one-launch", 1)
    truth, sights = observed(scene)
    bounds = bounds_of(scene, truth, sights, 0)
    burning = bounds.tick_s < truth.burns_s[0][-1, 1]
    assert np.all((bounds.position_m[burning] > 100.0) & (bounds.position_m[burning] < 1500.0))
    assert np.all(bounds.position_m <= bounds.free_position_m)
    # E|X| of a normal vector is within these factors of its root mean square, in one and in three
    # dimensions.
    assert np.all(
        (bounds.energy_m > 0.5 * bounds.position_m) & (bounds.energy_m < 0.7 * bounds.position_m)
    )


def test_flight_energy_is_work_of_thrust_and_drag() -> None:
    """After the last burnout, above the air, energy in the inertial frame is constant: two-body
    motion.
    """
    launch = scene_of("one-launch", 1).launches[0]
    end_s = float(burns(launch.row, launch.stages)[-1, 1])
    state = flown(launch.row[None], launch.stages, end_s + 100.0).states(
        np.array([end_s + 1.0, end_s + 100.0])
    )[0]
    velocity = state[:, 3:] + np.cross([0.0, 0.0, 7.292115e-5], state[:, :3])
    energy = 0.5 * np.sum(velocity**2, axis=1) - 3.986004418e14 / np.sqrt(
        np.sum(state[:, :3] ** 2, axis=1)
    )
    assert energy[1] == pytest.approx(energy[0], rel=1e-6)


def test_noise_of_two_widths_informs_as_its_draws_do() -> None:
    """The location of the mixture, by maximum likelihood, has the variance of the Fisher
    information.
    """
    rng = np.random.default_rng(3)
    share = 0.3
    sigma = np.where(rng.uniform(size=(300, 200)) < share, 3.0, 1.0)
    draws = rng.normal(size=(300, 200, 2)) * sigma[:, :, None]
    guess = np.median(draws, axis=1)
    for _ in range(15):  # expectation and maximisation
        square = np.sum((draws - guess[:, None]) ** 2, axis=2)
        near = (1.0 - share) * np.exp(-0.5 * square)
        far = share / 9.0 * np.exp(-square / 18.0)
        weight = (near + far / 9.0) / (near + far)
        guess = np.sum(draws * weight[:, :, None], axis=1) / weight.sum(axis=1)[:, None]
    assert np.sqrt(200.0 * np.mean(guess**2)) == pytest.approx(efficient_sigma(share), rel=0.08)
