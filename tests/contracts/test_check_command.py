"""`opir check` runs what pytest runs, without pytest; expected failures are named, have reasons,
are strict.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from opir_testing.contracts import HOMES, conformance_results, contract_for, contract_of
from opir_testing.contracts.contract import requirement, test_names as names_of
from opir_testing.json_schema import schema_errors

from opir_core.cli.main import main
from opir_core.host.components import CATALOGUE

pytest_plugins = ["pytester"]

#: No plugin of pytest but that of opir.
ALONE = ("--disable-plugin-autoload", "-p", "opir", "-p", "no:cacheprovider")


def opir(*words: str) -> subprocess.CompletedProcess[str]:
    # Without pytest: importing it would fail.
    code = (
        "import sys; sys.modules['pytest'] = None; from opir_core.cli.main import main;"
        " sys.exit(main())"
    )
    return subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=False
    )


def test_every_kind_has_a_contract_with_promises_in_words() -> None:
    assert HOMES.keys() == CATALOGUE.keys()
    for hook in HOMES:
        contract = contract_of(hook)
        tests = names_of(contract)
        assert len(tests) >= 5, contract
        for test in tests:
            assert requirement(contract, test).endswith("."), f"{contract.__name__}.{test}"


@pytest.mark.slow
def test_results_are_reported_one_by_one_without_pytest() -> None:
    done = opir("check", "weighted")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "confidence model weighted of opir-core 0.1.0 (plugin builtin)"
    assert lines[1:3] == [
        "  passed   `build` returns an object with all that its kind requires.",
        "  passed   Every setting has a help text, and the defaults are valid; settings do not change.",
    ]
    count = len(names_of(contract_of("opir_confidence_models")))
    assert lines[-1] == f"{count} of {count} conformance tests pass"


@pytest.mark.slow
def test_what_is_broken_is_reported_with_what_to_change() -> None:
    reported = {
        row.test: row
        for row in conformance_results(
            contract_for("opir_detection_models", "moody", {}, {}, ("broken_components",))
        )
    }
    row = reported["test_the_same_seed_gives_the_same_bytes"]
    assert row.state == "failed"
    assert "in a second run there are" in row.seen
    assert "Draw random numbers only from the argument `rng`" in row.change


@pytest.mark.parametrize(
    ("hook", "name", "words"),
    [
        ("opir_sinks", "built-of-none", "build made None without close, write"),
        ("opir_sinks", "without-close", "build made a WithoutClose without close"),
        ("opir_trackers", "without-step", "build made a WithoutStep without step"),
        ("opir_sensor_models", "forgets-to-return", "build returned None"),
        ("opir_metrics", "without-values", "build made a WithoutValues without values"),
    ],
)
def test_an_incomplete_part_is_the_only_result(hook: str, name: str, words: str) -> None:
    (row,) = conformance_results(contract_for(hook, name, {}, {}, ("broken_components",)))
    assert (row.test, row.state) == ("test_build_returns_a_complete_part", "failed")
    assert words in row.seen


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["check", "wieghted"], 3, "nearest: weighted"),
        (["check", "weighted", "--set", "bnad=2"], 4, "bnad: unknown key; did you mean band?"),
        (["check", "weighted", "--set", "band"], 2, "has no '='; write path=value"),
        (["check", "weighted", "--expect", "test_x"], 2, "write TEST=REASON, with a reason"),
        (
            ["check", "weighted", "--expect", "test_every_setting_is_documentd=x"],
            2,
            "the nearest is 'test_every_setting_is_documented'",
        ),
        (["check", "null", "--expect", "test_every_event_is_accounted_for=x"], 4, "it passes"),
    ],
)
def test_what_is_asked_wrongly_is_reported(
    words: list[str], code: int, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == code
    assert text in "".join(capsys.readouterr())


def test_json_has_every_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "null", "--json"]) == 0
    (reported,) = json.loads(capsys.readouterr().out)
    assert (reported["kind"], reported["name"], reported["distribution"]) == (
        "sink",
        "null",
        "opir-core",
    )
    assert [row["test"] for row in reported["tests"]] == names_of(contract_of("opir_sinks"))
    assert {row["state"] for row in reported["tests"]} == {"passed"}


CONTRACT_FILE = """
from opir_testing import ConfidenceContract

class TestMoody(ConfidenceContract):
    name = "{name}"
    plugins = ("broken_components",)
    expected_failures = {expected!r}
"""


@pytest.mark.parametrize(
    ("name", "expected", "outcomes"),
    [
        ("certain-by-rank", {}, {"failed": 1}),
        (
            "certain-by-rank",
            {"test_confidences_are_independent": "ranks are its point"},
            {"xfailed": 1},
        ),
        ("weighted", {"test_confidences_are_independent": "ranks are its point"}, {"failed": 1}),
        ("weighted", {}, {"passed": 1}),
    ],
)
def test_expected_failures_are_strict_in_pytest(
    pytester: pytest.Pytester, name: str, expected: dict[str, str], outcomes: dict[str, int]
) -> None:
    pytester.makepyfile(CONTRACT_FILE.format(name=name, expected=expected))
    test = "test_confidences_are_independent"
    pytester.runpytest_inprocess(*ALONE, "-k", test).assert_outcomes(**outcomes)


def test_an_expected_failure_of_no_test_is_refused_by_pytest(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(CONTRACT_FILE.format(name="weighted", expected={"test_nothing": "x"}))
    done = pytester.runpytest_inprocess(*ALONE)
    done.stderr.fnmatch_lines(["*expects test_nothing to fail: no such test, or no reason*"])


def test_the_pytest_plugin_imports_nothing_of_the_simulation(tmp_path: Path) -> None:
    (tmp_path / "test_nothing.py").write_text(
        "def test_nothing():\n    import sys\n    assert 'numpy' not in sys.modules\n"
    )
    words = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "opir_testing.pytest_plugin",
    ]
    alone = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        [*words, "."], cwd=tmp_path, env=alone, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_errors_of_an_event_have_their_place() -> None:
    schema = {
        "type": "object",
        "properties": {"bands": {"type": "array", "items": {"type": "number"}}},
    }
    assert schema_errors({"bands": [1.0, 2]}, schema) == []
    assert schema_errors({"bands": [1.0, "2"]}, schema) == [
        "event.bands[1]: '2' is not of type 'number'"
    ]
    assert schema_errors({"bands": [float("nan")]}, schema) == [
        "event.bands[0]: nan is not of type 'number'"
    ]
