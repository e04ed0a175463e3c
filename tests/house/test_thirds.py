"""Tests in thirds: three runs of CI run each of them once."""

import os
import subprocess
import sys
from collections import Counter

import pytest
from repository import ROOT
from thirds import QUICK, SLOW, chooser

IDS = [f"tests/core/test_{number}.py::test_it[{case}]" for number in range(100) for case in "abc"]


def test_each_test_is_in_one_third():
    thirds = Counter(
        third for third in ("1/3", "2/3", "3/3") for node_id in IDS if chooser(third)(node_id)
    )
    assert sum(thirds.values()) == len(IDS)
    assert min(thirds.values()) > 70
    assert all(sum(chooser(third)(node_id) for third in thirds) == 1 for node_id in IDS)


@pytest.mark.parametrize("everything", ["", "all"])
def test_all_tests_are_run_unless_a_third_is_named(everything):
    assert all(map(chooser(everything), IDS))


@pytest.mark.parametrize("third", ["0/3", "4/3", "1", "1/0", "first", "-1/3"])
def test_what_is_no_third_is_refused(third):
    with pytest.raises(pytest.UsageError, match="OPIR_THIRD must be all, 1/3, 2/3 or 3/3"):
        chooser(third)


@pytest.mark.slow
def test_each_quick_test_of_a_file_is_run_in_one_third():
    thirds = [collected({QUICK: f"{number}/3"}) for number in (1, 2, 3)]
    assert Counter(test for third in thirds for test in third) == Counter(collected({}))
    assert collected({SLOW: "1/3"}) == collected({})


def collected(variables):
    """Return the quick tests that pytest would run of this file under some variables."""
    clean = {key: value for key, value in os.environ.items() if key not in (QUICK, SLOW)}
    listed = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "--collect-only",
            "-q",
            "-p",
            "no:cacheprovider",
            __file__,
        ],
        cwd=ROOT,
        env=clean | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    return {line for line in listed.stdout.splitlines() if "::" in line}
