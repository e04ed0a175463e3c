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


@pytest.fixture
def optimised(tmp_path, monkeypatch, capsys):
    """Return a function that optimises over revisit times, and returns the exit code and texts."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(json.dumps(SCENE), encoding="utf-8")

    def command(words: str, *more: str):
        code = main(["optimise", "scene.yaml", *words.split(), *more])
        return code, capsys.readouterr()

    return command


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
        distance = np.subtract(point, best)
        coupled = 1.2 * distance[0] * distance[1] * min(weight[:2])
        violation = max(0.0, 0.1 * (best[2] - point[2]))
        return Outcome(0.0, violation, float(np.sum(weight * distance**2) + coupled))

    search = DesignSearch((10,) * 4, (True,) * 4, seed)
    search.run(200, lambda points: list(map(outcome, points)))
    assert search.best == best
    assert len(search.outcomes) <= 200


def test_all_of_few_designs_are_evaluated_once() -> None:
    pytest.importorskip("optuna")
    evaluated = []

    def outcomes(points):
        evaluated.extend(points)
        return [Outcome(0.0, 0.0, float(sum(point))) for point in points]

    search = DesignSearch((3, 2), (True, False), 1)
    search.run(50, outcomes)
    assert sorted(evaluated) == [(a, b) for a in range(3) for b in range(2)]
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
def test_the_best_design_is_that_of_the_sweep_and_runs_stay(tmp_path) -> None:
    pytest.importorskip("optuna")
    optimised = optimise(STUDY, tmp_path, "min latency_s", evaluations=12)
    means = [row["mean"] for row in optimised.result.rows("latency_s")]
    assert optimised.best == int(np.nanargmin(means))
    assert (len(means), optimised.possible, optimised.is_feasible) == (12, 12, True)
    files = set((tmp_path / "parts").iterdir())
    repeated = optimise(STUDY, tmp_path, "min latency_s", evaluations=12)
    assert repeated.result.definition == optimised.result.definition
    assert set((tmp_path / "parts").iterdir()) == files


@pytest.mark.slow
def test_requirements_come_before_the_objective(optimised) -> None:
    pytest.importorskip("optuna")
    words = f"--vary {PERIOD}=100,500,2000 --runs 3 --metric latency --executor serial --json"
    command = words, "--objective", "max latency_s", "--require"
    code, printed = optimised(*command, "latency_s <= 1")
    best = json.loads(printed.out)
    assert code == 0
    assert best["means"]["latency_s"] <= 1.0
    assert best["best"][PERIOD] == 500
    code, printed = optimised(*command, "latency_s <= 1e-6")
    assert code == 2
    assert json.loads(printed.out)["best"][PERIOD] == 100


def test_an_invalid_objective_is_refused(tmp_path) -> None:
    pytest.importorskip("optuna")
    with pytest.raises(SceneError, match="is not 'min FIGURE' or 'max FIGURE'"):
        optimise(STUDY, tmp_path, "latency_s")
    with pytest.raises(SceneError, match="gives 'latenci_s'; the nearest is 'latency_s'"):
        optimise(STUDY, tmp_path, "min latenci_s")


@pytest.mark.parametrize(
    ("flag", "words"),
    [
        ("--workers", "is not a number of workers"),
        ("--evaluations", "is not a number of designs"),
    ],
)
def test_impossible_numbers_are_refused(optimised, flag, words) -> None:
    command = f"--vary {PERIOD}=100,500 {flag} -1 --objective"
    code, printed = optimised(command, "min latency_s")
    assert code == 2
    assert f"-1 {words}" in printed.err


def test_without_optuna_the_message_says_what_to_install(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(PluginError, match=r"pip install .*'./plugins/opir_studies\[optimise\]'"):
        optimise(STUDY, tmp_path, "min latency_s")
