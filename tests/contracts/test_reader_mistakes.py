"""Mistakes that an author of a reader makes in the template: each is found, by the test that is named."""

import sys
from pathlib import Path

import pytest
from opir_testing.contracts import conformance_results, contract_for

from opir_core.cli.main import main

REFUSAL = 'raise BadFileError(f"line {line}: is not a time and three coordinates") from None'

#: What is written in place of what, and the first test that fails.
MISTAKES = {
    "kilometres as metres": (
        "1e3 * x_km, 1e3 * y_km, 1e3 * z_km",
        "x_km, y_km, z_km",
        "test_places_are_above_the_ground",
    ),
    "no reason": (
        REFUSAL,
        "raise BadFileError from None",
        "test_a_spoilt_file_is_refused_with_the_reason",
    ),
    "Python's own error": (REFUSAL, "raise", "test_a_spoilt_file_is_refused_with_the_reason"),
    "times in any order": (
        "or not (np.diff(table[:, 0]) > 0.0).all()",
        "",
        "test_a_spoilt_file_is_refused_with_the_reason",
    ),
    "a burn without duration": (
        "table[[[0, -1]], 0]",
        "table[[[0, 0]], 0]",
        "test_it_yields_what_it_says",
    ),
    "rows of the file before": (
        "    rows = []\n",
        "    rows = build.__dict__.setdefault('rows', [])\n",
        "test_it_yields_what_it_says",
    ),
}


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("template")
    assert main(["new-plugin", "reader", "mine", "--into", str(folder)]) == 0
    return (folder / "mine" / "mine.py").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_found(
    name: str, template: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right, wrong, test = MISTAKES[name]
    assert template.count(right) == 1
    module = f"reader_{list(MISTAKES).index(name)}"
    (tmp_path / f"{module}.py").write_text(template.replace(right, wrong), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    contract = contract_for("opir_readers", "mine", {}, {}, (module,))
    failed = [row.test for row in conformance_results(contract) if row.state != "passed"]
    assert test in failed
    assert module in sys.modules
