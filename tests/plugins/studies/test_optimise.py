"""The search finds planted designs, continues where it was stopped, and says what meets no
requirement.
"""

import json
import sys
from typing import Any

import numpy as np
import pytest
from opir_studies import Study, optimise
from opir_studies.axes import axis_of
from opir_studies.optimising import _is_ordered
from opir_studies.search import DesignSearch, Outcome
from study_scene import PERIOD, SCENE

from opir_core.cli.main import main
from opir_core.errors import PluginError, SceneError

STUDY = Study(
    scene=SCENE,
    vary={PERIOD: [5000, 500, 2000, 100], "sensors[*].detection_probability.ICBM": [0.2, 0.5, 0.9]},
    runs=3,
    metrics=("latency",),
    executor="serial",
)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 4, 6])
def test_a_planted_design_of_10_000_is_found_in_200_evaluations(seed: int) -> None:
    """The values of the four settings are coupled, and a third of all designs violate a
    requirement.
    """
    pytest.importorskip("optuna")
    rng = np.random.default_rng(seed)
    best = tuple(rng.integers(2, 8, 4).tolist())
    weight = rng.uniform(0.5, 2.0, 4)

    def outcome(point: tuple[int, ...]) -> Outcome:
        apart = np.subtract(point, best)
        coupled = 1.2 * apart[0] * apart[1] * min(weight[:2])
        return Outcome(
            0.0, max(0.0, 0.1 * (best[2] - point[2])), float(np.sum(weight * apart**2) + coupled)
        )

    search = DesignSearch((10,) * 4, (True,) * 4, seed)
    search.run(200, lambda points: [outcome(each) for each in points])
    assert search.best == best
    assert len(search.outcomes) <= 200


def test_all_of_few_designs_are_evaluated_once() -> None:
    pytest.importorskip("optuna")
    asked = []

    def outcomes(points):
        asked.extend(points)
        return [Outcome(0.0, 0.0, float(sum(each))) for each in points]

    search = DesignSearch((3, 2), (True, False), 1)
    search.run(50, outcomes)
    assert sorted(asked) == [(a, b) for a in range(3) for b in range(2)]
    assert search.best == (0, 0)


@pytest.mark.parametrize(
    ("values", "is_ordered"),
    [
        ([2, 1, 3], True),
        ([0.5, 2], True),
        ([True, False], False),
        ([1, "many"], False),
        (["few", "many"], False),
        ([None, 2], False),
        ([0, True], False),
    ],
)
def test_numbers_alone_have_neighbours(values: list[Any], is_ordered: bool) -> None:
    """The search steps to the next level of what is ordered; truth values and names have no next
    one.
    """
    assert _is_ordered(axis_of("p", values)) is is_ordered


@pytest.mark.slow
def test_the_best_design_is_that_of_the_whole_sweep_and_runs_are_kept(tmp_path) -> None:
    pytest.importorskip("optuna")
    calls = []
    found = optimise(STUDY, tmp_path, "min latency_s", evaluations=12, on_progress=calls.append)
    means = [row["mean"] for row in found.result.rows("latency_s")]
    assert found.best == int(np.nanargmin(means))
    assert (len(means), found.possible, found.is_feasible) == (12, 12, True)
    parts = sorted(path.name for path in (tmp_path / "parts").iterdir())
    again = optimise(STUDY, tmp_path, "min latency_s", evaluations=12)
    assert again.result.definition == found.result.definition
    assert sorted(path.name for path in (tmp_path / "parts").iterdir()) == parts


@pytest.mark.slow
def test_requirements_come_before_the_objective(tmp_path, capsys) -> None:
    pytest.importorskip("optuna")
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps(SCENE), encoding="utf-8")
    command = [
        "optimise",
        str(scene),
        "--vary",
        f"{PERIOD}=100,500,2000",
        "--runs",
        "3",
        "--metric",
        "latency",
    ]
    command += [
        "--executor",
        "serial",
        "--objective",
        "max latency_s",
        "-o",
        str(tmp_path / "out"),
        "--json",
    ]
    assert main([*command, "--require", "latency_s <= 1"]) == 0
    best = json.loads(capsys.readouterr().out)
    assert best["means"]["latency_s"] <= 1.0
    assert best["best"][PERIOD] == 500
    assert main([*command, "--require", "latency_s <= 1e-6"]) == 2
    assert json.loads(capsys.readouterr().out)["best"][PERIOD] == 100


def test_what_is_no_objective_is_refused(tmp_path) -> None:
    pytest.importorskip("optuna")
    with pytest.raises(SceneError, match="is not 'min FIGURE' or 'max FIGURE'"):
        optimise(STUDY, tmp_path, "latency_s")
    with pytest.raises(SceneError, match="gives 'latenci_s'; the nearest is 'latency_s'"):
        optimise(STUDY, tmp_path, "min latenci_s")


def test_impossible_numbers_are_refused(tmp_path, capsys) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps(SCENE), encoding="utf-8")
    command = [
        "optimise",
        str(scene),
        "--vary",
        f"{PERIOD}=100,500",
        "--objective",
        "min latency_s",
    ]
    for flag, words in (
        ("--workers", "is not a number of workers"),
        ("--evaluations", "is not a number of designs"),
    ):
        assert main([*command, flag, "-1"]) == 2
        assert f"-1 {words}" in capsys.readouterr().err


def test_without_optuna_the_message_says_what_to_install(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(PluginError, match=r"pip install './plugins/opir_studies\[optimise\]'"):
        optimise(STUDY, tmp_path, "min latency_s")
