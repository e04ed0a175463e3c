"""`opir prior fit`: stages of flights by SciPy, the law of some of them, and a tracker that uses
it.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from opir_forecast.prior_command import LEAST, WIDEN, RecordedFlight, fitted, recorded_flight
from opir_forecast.vehicles import vehicle_model
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.tracker import imm_tracker
from scipy.integrate import solve_ivp

import opir_core as opir
from opir_core.cli.main import main
from opir_core.errors import ModelError, OpirError
from opir_core.interfaces.contexts import TrackerContext

MU = 3.986004418e14
SPIN = np.array([0.0, 0.0, 7.292115e-5])
RADIUS_M = 6378137.0
HEAD = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"


def written(path: Path, stages: list[tuple[float, float, float, float]]) -> Path:
    """Write a table of a flight from the equator, thrust along the velocity: burn, acceleration,
    ratio, gap.
    """
    now = 0.0
    state = np.array([RADIUS_M, 0.0, 0.0, 1.0, 0.02, 0.0])
    rows = []

    def rates(
        time_s: float, state: np.ndarray, start: float, first: float, rate: float
    ) -> np.ndarray:
        place = state[:3]
        velocity = state[3:]
        size = first / (1.0 - rate * (time_s - start)) if first else 0.0
        pull = -MU / np.linalg.norm(place) ** 3 * place
        turning = -2.0 * np.cross(SPIN, velocity) - np.cross(SPIN, np.cross(SPIN, place))
        return np.concatenate(
            [velocity, pull + turning + size * velocity / np.linalg.norm(velocity)]
        )

    for burn, first, ratio, gap in stages:
        rate = (1.0 - 1.0 / ratio) / burn
        for length, size, is_on in ((burn, first, 1), (gap, 0.0, 0)):
            times = np.linspace(now, now + length, int(length / 0.5) + 2)
            leg = solve_ivp(
                rates,
                (now, now + length),
                state,
                args=(now, size, rate),
                t_eval=times,
                rtol=1e-9,
                atol=1e-6,
            )
            rows += [[time, *column, is_on] for time, column in zip(leg.t, leg.y.T, strict=True)]
            state = leg.y[:, -1]
            now = now + length
    np.savetxt(path, rows, delimiter=",", header=HEAD, comments="", fmt="%.6f")
    return path


STAGES = [(60.0, 22.0, 2.5, 8.0), (50.0, 18.0, 3.0, 20.0)]


def test_stages_of_a_table_are_those_that_were_flown(tmp_path: Path) -> None:
    flight = recorded_flight(written(tmp_path / "one.csv", STAGES))
    assert not flight.orbits
    assert flight.stages[:, 0] == pytest.approx([60.0, 50.0], abs=0.6)
    assert flight.stages[:, 1] == pytest.approx([22.0, 18.0], rel=0.02)
    assert flight.stages[:, 2] == pytest.approx([2.5, 3.0], rel=0.05)
    assert flight.stages[0, 3] == pytest.approx(8.0, abs=0.6)
    assert np.isnan(flight.stages[1, 3])


def test_a_burn_against_the_motion_is_no_stage(tmp_path: Path) -> None:
    """A stage that flies back brakes with thrust against its velocity: it and what follows are left
    out.
    """
    path = written(tmp_path / "back.csv", [STAGES[0], (20.0, -30.0, 1.2, 5.0), STAGES[1]])
    flight = recorded_flight(path)
    assert flight.stages.shape == (1, 4)
    assert flight.stages[0, 0] == pytest.approx(60.0, abs=0.6)
    assert np.isnan(flight.stages[0, 3])


def test_spreads_are_widened_and_what_no_flight_shows_stays() -> None:
    own = vehicle_model().data["families"]
    burns = np.array([50.0, 60.0, 72.0, 90.0])
    law = fitted([RecordedFlight(np.array([[burn, 25.0, 2.0, np.nan]]), False) for burn in burns])[
        "families"
    ]
    assert law["missile"]["first"]["median"][:3] == pytest.approx(
        [np.exp(np.log(burns).mean()), 25.0, 2.0], rel=1e-3
    )
    assert law["missile"]["first"]["sigma"][0] == pytest.approx(
        max(WIDEN * np.log(burns).std(ddof=1), LEAST[0]), abs=1e-3
    )
    assert law["missile"]["first"]["sigma"][1] == LEAST[1]
    assert law["missile"]["first"]["median"][3] == own["missile"]["first"]["median"][3]
    assert law["missile"]["upper"] == own["missile"]["upper"]
    assert law["missile"]["stages"][0] > 0.6
    assert law["space"] == own["space"]


@pytest.mark.slow
def test_the_command_writes_a_law_that_the_tracker_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(written(tmp_path / f"{k}.csv", STAGES[: 1 + k % 2])) for k in range(2)]
    out = tmp_path / "prior.json"
    assert main(["prior", "fit", *files, "-o", str(out)]) == 0
    one, two = capsys.readouterr().out.splitlines()[1:]
    assert one.endswith("0.csv: missile; burns of 60 s from 22.0 m/s2 to 0.40 of the mass")
    assert "; burns of 60 s from " in two
    assert ", 8 s dark; 50 s from " in two
    assert json.loads(out.read_text())["families"]["missile"]["upper"]["median"][
        0
    ] == pytest.approx(50.0, abs=1.0)
    context = TrackerContext(sensors=(), epoch_us=0, duration_s=10.0)
    assert imm_tracker(ImmConfig(boost_prior=str(out)), context) is not None


def test_what_is_no_flight_and_no_law_is_refused_with_its_place(tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("time_s,x\n1,2\n")
    with pytest.raises(OpirError, match=r"bad\.csv: 1 problem\n  no column x_ecef_m"):
        recorded_flight(bad)
    dark = tmp_path / "dark.csv"
    dark.write_text(HEAD + "\n" + "\n".join(f"{k},7e6,0,0,0,1,0,0" for k in range(9)))
    with pytest.raises(OpirError, match="no burn"):
        recorded_flight(dark)


@pytest.mark.parametrize(
    ("key", "value", "is_read"),
    [
        ("vertical_rise_s", [0.0, 12.0], True),
        ("failure_probability", 0.0, True),
        ("highest_m_s2", 60.0, True),
        ("highest_m_s2", 1.2e6, False),
        ("failure_probability", 1.5, False),
        ("steer_period_s", [0.0, 600.0], False),
        ("glide", {"height_km": [35e3, 110e3], "angle_deg": [-8.0, 8.0], "least_m_s": 2e3}, True),
        ("glide", {"height_km": [35e6, 11e7], "angle_deg": [-8.0, 8.0], "least_m_s": 2e3}, False),
    ],
)
def test_numbers_of_a_law_may_be_zero_and_not_of_another_unit(
    tmp_path: Path, key: str, value: object, is_read: bool
) -> None:
    path = tmp_path / "law.json"
    path.write_text(json.dumps({**vehicle_model().data, key: value}))
    if is_read:
        assert vehicle_model(str(path)).data[key] == value
    else:
        with pytest.raises(ModelError, match=f"holds no law of vehicles: {key}.* is not in "):
            vehicle_model(str(path))


def test_a_prior_that_cannot_be_used_is_reported_with_its_setting_and_the_way_out(
    tmp_path: Path,
) -> None:
    own = dict(vehicle_model().data)
    bad = {
        "no.csv": ("time_s,x\n1,2\n", "holds no law of vehicles"),
        "list.json": ("[1, 2]", "holds no law of vehicles"),
        "part.json": (json.dumps({"families": own["families"]}), "no note, source, none_spread"),
        "short.json": (json.dumps({**own, "marginal": {}}), "no range_km, density"),
        "thin.json": (
            json.dumps(
                {
                    **own,
                    "families": {**own["families"], "space": own["families"]["missile"]["first"]},
                }
            ),
            "no stages, first",
        ),
    }
    for name, (content, why) in bad.items():
        (tmp_path / name).write_text(content)
        with pytest.raises(
            ModelError,
            match=rf"^tracker\.boost_prior: .*{name} .*{why}.*; write one with `opir prior",
        ):
            vehicle_model(str(tmp_path / name))
    with pytest.raises(
        ModelError, match=r"^tracker\.boost_prior: .*none\.json cannot be read: no such file"
    ):
        vehicle_model(str(tmp_path / "none.json"))
    scene = {
        "scene": "bad",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 10.0,
        "seed": 1,
        "outputs": [],
    }
    scene |= {
        "sensors": [{"constellation": "SBIRS-GEO"}],
        "tracker": {"model": "imm", "boost_prior": "none.json"},
    }
    with pytest.raises(ModelError, match=r"^tracker\.boost_prior: none\.json cannot be read"):
        opir.simulate(opir.scene_from_mapping(scene))
