"""Sources and launches that share lines of sight: no track without a source, and honest states."""

import numpy as np
import pytest
from opir_scoring import evidence_of_run
from opir_scoring.evidence import true_states_ecef

import opir_core as opir

EPOCH = "2026-04-01T20:00:00Z"


def two_sensors(middle_deg: float) -> list[dict[str, object]]:
    return [
        {"model": "SBIRS-GEO", "id": f"S{row}", "orbital_slot_deg": middle_deg + side_deg}
        for row, side_deg in enumerate((-35.0, 30.0))
    ]


def flares(seed: int, half_width_km: float, duration_s: float) -> opir.Run:
    """Return a run of six groups of five steady flares."""
    rng = np.random.default_rng(seed)
    groups = np.repeat(rng.uniform((3.0, 20.0), (9.0, 30.0), (6, 2)), 5, axis=0)
    places = groups + rng.uniform(-half_width_km, half_width_km, groups.shape) / 111.2
    at = [{"lat_deg": lat, "lon_deg": lon, "area_m2": 200.0} for lat, lon in places.tolist()]
    return opir.simulate(
        opir.scene_from_mapping(
            {
                "scene": "flares",
                "epoch": EPOCH,
                "duration_s": duration_s,
                "seed": seed,
                "sensors": two_sensors(25.0),
                "targets": [],
                "detection": "snr",
                "tracker": {"model": "imm", "forecast": "none"},
                "sources": [{"id": "flares", "model": "flares", "at": at}],
            }
        )
    )


@pytest.mark.slow
def test_groups_of_flares_have_a_track_each_and_none_of_one_tick() -> None:
    run = flares(77, 3.0, 20.0)
    number, ticks = np.unique(run.tracks.track, return_counts=True)
    assert len(number) <= 30 * 1.1
    assert ticks.min() > 1
    assert np.isin(number, run.detections.track).all()


@pytest.mark.slow
@pytest.mark.parametrize("half_width_km", [0.5, 1.5])
def test_what_is_chosen_by_nearness_does_not_make_a_sensor_better(half_width_km: float) -> None:
    run = flares(613, half_width_km, 10.0)
    for sensor in run.summary["sensors"]:
        health = sensor["health"]
        scale = health["noise_scale"]
        sigma = health["noise_scale_sigma"]
        assert scale is None or abs(scale - 1.0) <= 3.0 * sigma
        assert (health["outlier_share"] or 0.0) <= 0.05


def salvo(seed: int, association: str) -> opir.Run:
    """Return a run of eight launches within 20 s from a field of ± 5 km."""
    rng = np.random.default_rng(seed)
    shift_deg = rng.uniform(-5.0, 5.0, (8, 2)) / 111.2
    times_s = rng.uniform(10.0, 30.0, 8).tolist()
    aim_deg = shift_deg + rng.uniform(-0.3, 0.3, (8, 2))
    targets = [
        {
            "id": f"T{row}",
            "model": "gravity-turn",
            "type": "SRBM",
            "launch": {"lat_deg": 35.0 + start[0], "lon_deg": 50.0 + start[1], "time_s": time_s},
            "aim": {"lat_deg": 32.0 + end[0], "lon_deg": 52.0 + end[1]},
        }
        for row, (start, end, time_s) in enumerate(
            zip(shift_deg.tolist(), aim_deg.tolist(), times_s, strict=True)
        )
    ]
    return opir.simulate(
        opir.scene_from_mapping(
            {
                "scene": "salvo",
                "epoch": EPOCH,
                "duration_s": 70.0,
                "seed": seed,
                "sensors": two_sensors(50.0),
                "targets": targets,
                "tracker": {"model": "imm", "forecast": "none", "association": association},
            }
        )
    )


def normalised_squares(run: opir.Run) -> np.ndarray:
    """Return NEES / 6 of the track nearest to each launch that burns, at every fourth tick."""
    evidence = evidence_of_run(run, run.plan)
    targets = run.plan.targets
    squares = []
    for tick_s in np.arange(36.0, 64.0, 4.0):
        tracks = run.tracks.take(np.flatnonzero(run.tracks.tick_s == tick_s))
        is_lit = (targets.ignition_s < tick_s - 4.0) & (targets.burnout_s > tick_s)
        lit = np.flatnonzero(is_lit).astype(np.int32)
        truth = true_states_ecef(evidence.plan, lit, np.full(len(lit), tick_s))
        for state in truth:
            row = np.argmin(np.linalg.norm(tracks.state[:, :3] - state[:3], axis=1))
            error = tracks.state[row] - state
            squares.append(error @ np.linalg.solve(tracks.state_covariance[row], error) / 6.0)
    return np.array(squares)


@pytest.mark.slow
def test_a_salvo_is_honest_with_probable_labels_and_not_with_certain_ones() -> None:
    medians = {
        association: np.median(
            np.concatenate([normalised_squares(salvo(seed, association)) for seed in (901, 902)])
        )
        for association in ("jpda", "gnn")
    }
    assert 0.5 < medians["jpda"] < 2.0
    assert medians["gnn"] > 1.5 * medians["jpda"]
