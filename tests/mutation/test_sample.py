"""The sampler: all tokens are equally likely, and which tests a mutant meets, in which order, and
what they say.
"""

import importlib.util
import sys
from collections import Counter
from pathlib import Path

import mutation_environment
import pytest
from import_distances import distances, imports_of
from repository import ROOT
from scipy.stats import chisquare

SPEC = importlib.util.spec_from_file_location(
    "mutation_sample", Path(__file__).with_name("sample.py")
)
assert SPEC is not None
assert SPEC.loader is not None
sample = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = sample
SPEC.loader.exec_module(sample)

SOURCES = {"one.py": "a = 1\n", "two.py": "b = c + d\nreturned = not e < f\n"}


def test_all_tokens_are_equally_likely():
    """Chi-squared over 4 tokens in 800 draws, at 1e-4; two of three files' tokens are in the longer
    file.
    """
    drawn = [sample.draw(SOURCES, 1, seed)[0][0] for seed in range(800)]
    counts = Counter((mutant.file, mutant.token) for mutant in drawn)
    assert set(counts) == {("one.py", "1"), ("two.py", "+"), ("two.py", "not"), ("two.py", "<")}
    assert chisquare(list(counts.values())).pvalue > 1e-4
    assert {mutant.choice for mutant in drawn if mutant.token == "<"} == {"<=", ">="}


def test_tokens_are_drawn_once_each_and_a_seed_repeats_the_draw():
    drawn = sample.draw(SOURCES, 99, 5)
    assert sorted((mutant.file, mutant.token) for mutant, _ in drawn) == [
        ("one.py", "1"),
        *(("two.py", token) for token in ("+", "<", "not")),
    ]
    assert sample.draw(SOURCES, 99, 5) == drawn


def test_a_mutant_is_reported_with_its_line_before_and_after():
    (mutant,) = (mutant for mutant, _ in sample.draw(SOURCES, 4, 5) if mutant.token == "not")
    assert (mutant.line, mutant.before, mutant.after) == (
        2,
        "returned = not e < f",
        "returned =  e < f",
    )


@pytest.mark.parametrize(
    ("file", "folder"),
    [
        ("opir_core/flight/kepler.py", "tests/core/flight"),
        ("opir_core/flight/tables/csv.py", "tests/core/flight"),
        ("plugins/opir_testing/opir_testing/contracts/trackers.py", "tests/contracts"),
        ("opir_core/arrays.py", None),
        ("plugins/opir_estimation/opir_estimation/gating.py", "tests/plugins/estimation"),
        ("plugins/opir_trackers/opir_trackers/imm/prune.py", "tests/plugins/trackers/imm"),
        ("plugins/opir_dsp/opir_dsp/plugin.py", None),
    ],
)
def test_tests_lie_where_their_modules_do(file, folder):
    assert sample.mirror(file) == (folder and ROOT / folder)


def test_tests_of_the_folder_come_first_and_the_nearest_first(monkeypatch, tmp_path):
    files = {
        "opir_core/flight/arc.py": "",
        "opir_core/flight/motion.py": "from opir_core.flight import arc",
        "tests/core/flight/test_aiming.py": "",
        "tests/core/flight/test_arc.py": "",
        "tests/core/scene/test_near.py": "from opir_core.flight.arc import a",
        "tests/core/scene/test_a_far.py": "import opir_core.flight.motion",
        "tests/core/scene/test_other.py": "import opir_core",
    }
    write(tmp_path, files)
    monkeypatch.setattr(sample, "ROOT", tmp_path)
    stages = sample.stages_of(
        "opir_core/flight/arc.py", imports_of(tmp_path, files), ["test_x.py::test_y"]
    )
    folder_tests = ["tests/core/flight/test_arc.py", "tests/core/flight/test_aiming.py"]
    other_tests = ["tests/core/scene/test_near.py", "tests/core/scene/test_a_far.py"]
    left_out = "--deselect=test_x.py::test_y"
    assert [stage.words() for stage in stages] == [
        ["-m", "not slow", left_out, *folder_tests],
        ["-m", "slow", left_out, *folder_tests],
        ["-m", "not slow", left_out, *other_tests, *sample.DOCUMENTED],
        ["-m", "slow", left_out, *other_tests],
    ]


def test_imports_are_counted_through_helpers_plugins_and_names_in_strings(tmp_path):
    files = {
        "opir_core/host/host.py": "PLUGINS = ['opir_core.builtin.sinks']",
        "opir_core/builtin/sinks.py": "",
        "plugins/opir_dsp/opir_dsp/plugin.py": "from opir_core.builtin import sinks",
        "tests/support/scenes.py": "FLEETS = ['opir_dsp']",
        "tests/plugins/test_fleets.py": "import scenes",
    }
    write(tmp_path, files)
    assert distances("opir_core/builtin/sinks.py", imports_of(tmp_path, files)) == {
        "opir_core/host/host.py": 1,
        "plugins/opir_dsp/opir_dsp/plugin.py": 1,
        "tests/support/scenes.py": 2,
        "tests/plugins/test_fleets.py": 3,
    }


def write(folder, files):
    for name, source in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(source)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "limits_s", "outcome", "reported"),
    [
        ("def test_a(): pass", (60, 90), "survived", "all not slow passed"),
        ("def test_a(): assert False", (60, 90), "killed", "FAILED test_a.py::test_a"),
        ("import nothing_of_this_name", (60, 90), "killed", "ERROR test_a.py"),
        ("import time\ndef test_a(): time.sleep(90)", (5, 90), "hang", "no test ended in 5 s"),
        (
            "import time\ndef test_a(): time.sleep(90)",
            (60, 5),
            "survived",
            "tests left out at the time limit",
        ),
    ],
)
def test_what_tests_say_of_a_mutant(tmp_path, source, limits_s, outcome, reported):
    verdict = sample._outcome(
        checkout(tmp_path, source),
        sample.Stage(["test_a.py"], "not slow"),
        sample.Limits(*limits_s),
    )
    assert verdict.kind == outcome
    assert verdict.by.startswith(reported)


def checkout(folder, source):
    """Return a folder like a copy of the checkout, with one file of tests."""
    settings = (
        "from hypothesis import settings\nsettings.register_profile('unshrunk', max_examples=1)\n"
    )
    files = {
        "test_a.py": source,
        "conftest.py": settings,
        "plugins/opir_x/x.py": "",
        "pytest.ini": "[pytest]\nmarkers = slow\naddopts = --disable-plugin-autoload -p"
        " hypothesispytest -p xdist",
    }
    write(folder, files)
    return folder


#: What the tests of a copy may be without a mutant.
FAILS = "import nothing_of_this_name\n"
PASSES = "def test_a(): pass\n"
SLEEPS = "import time\ndef test_a(): time.sleep({})\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("outcome", "unmutated", "confirmed"),
    [
        (("killed", "by", "test_a.py::test_a"), PASSES, "killed"),
        (("killed", "by", ""), PASSES, "killed"),
        (("hang", "by", "test_a.py::test_a"), PASSES, "hang"),
        (("hang", "by", "test_a.py::test_a"), SLEEPS.format(2.1), "survived"),
    ],
)
def test_a_kill_counts_if_its_test_ends_well_without_the_mutant(
    tmp_path, outcome, unmutated, confirmed
):
    """The limit is 20 s: a hang counts if the test takes less than 2 s, however long the process
    takes.
    """
    stage = sample.Stage(["test_a.py"], "not slow")
    copy = checkout(tmp_path, unmutated)
    verdict = sample._confirmed(copy, stage, sample.Outcome(*outcome), sample.Limits(20.0, 60.0))
    assert verdict.kind == confirmed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unmutated", "test"), [(FAILS, ""), ("def test_a(): assert False", "test_a.py::test_a")]
)
def test_an_environment_in_which_a_killing_test_fails_anyway_is_refused(tmp_path, unmutated, test):
    stage = sample.Stage(["test_a.py"], "not slow")
    outcome = sample.Outcome("killed", "by", test)
    with pytest.raises(
        SystemExit, match=r"(?s)cannot be judged .*fails without a mutant.* test_a.py.*make install"
    ):
        sample._confirmed(checkout(tmp_path, unmutated), stage, outcome, sample.Limits(60.0, 60.0))


def test_an_environment_without_the_libraries_of_tests_is_refused(
    monkeypatch,
):
    monkeypatch.setattr(
        mutation_environment.peer_libraries, "missing", lambda: {"numba", "astropy"}
    )
    with pytest.raises(SystemExit, match=r"(?s)`peers` is missing: astropy, numba\..*make install"):
        mutation_environment.check_libraries()


def test_packages_that_are_imported_from_elsewhere_are_refused(tmp_path):
    """In a copy, `json` of the standard library is elsewhere, and `opir_x` is that of the copy with
    its path only.
    """
    copy = tmp_path.resolve()
    write(copy, {"plugins/opir_x/opir_x/__init__.py": "", "tests/a": ""})
    assert mutation_environment.packages_of(["plugins/opir_x/opir_x/a.py", "opir_core/b/c.py"]) == [
        "opir_core",
        "opir_x",
    ]
    mutation_environment.check_installation(copy, ["opir_x"], sample._variables(copy))
    with pytest.raises(
        SystemExit, match=r"(?s)not imported from .*opir_x \(not installed\).*make install"
    ):
        mutation_environment.check_installation(copy, ["opir_x"])
    with pytest.raises(SystemExit, match=r"json \(.*__init__\.py\)"):
        mutation_environment.check_installation(copy, ["json", "opir_x"], sample._variables(copy))


@pytest.mark.slow
def test_a_changed_module_is_what_its_tests_import_and_then_is_as_before(tmp_path):
    """Sizes and times of the sources are the same, so that a stale compiled file would be
    believed.
    """
    write(tmp_path, {"opir_a.py": "A = 1\n", "pytest.ini": "[pytest]\npythonpath = .\n"})
    for value in (1, 2, 3):
        sample._write(tmp_path / "opir_a.py", f"A = {value}\n")
        result = sample.subprocess.run(
            [sys.executable, "-c", "import opir_a; print(opir_a.A)"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )
        assert result.stdout == f"{value}\n"
