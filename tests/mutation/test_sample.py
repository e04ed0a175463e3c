"""The sampler: all tokens are equally likely, and which tests a mutant meets, in which order, and what they say."""

import importlib.util
import sys
from collections import Counter
from pathlib import Path

import pytest
from import_distances import distances, imports_of
from repository import ROOT
from scipy.stats import chisquare

SPEC = importlib.util.spec_from_file_location("mutation_sample", Path(__file__).with_name("sample.py"))
assert SPEC is not None
assert SPEC.loader is not None
sample = sys.modules[SPEC.name] = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(sample)

SOURCES = {"one.py": "a = 1\n", "two.py": "b = c + d\nreturned = not e < f\n"}


def test_all_tokens_are_equally_likely() -> None:
    """Chi-squared over 4 tokens in 800 draws, at 1e-4; two of three files' tokens are in the longer file."""
    drawn = [sample.draw(SOURCES, 1, seed)[0][0] for seed in range(800)]
    counts = Counter((mutant.file, mutant.token) for mutant in drawn)
    assert set(counts) == {("one.py", "1"), ("two.py", "+"), ("two.py", "not"), ("two.py", "<")}
    assert chisquare(list(counts.values())).pvalue > 1e-4
    assert {mutant.choice for mutant in drawn if mutant.token == "<"} == {"<=", ">="}


def test_tokens_are_drawn_once_each_and_a_seed_repeats_the_draw() -> None:
    drawn = sample.draw(SOURCES, 99, 5)
    assert sorted((mutant.file, mutant.token) for mutant, _ in drawn) == [
        ("one.py", "1"),
        *(("two.py", token) for token in ("+", "<", "not")),
    ]
    assert sample.draw(SOURCES, 99, 5) == drawn


def test_a_mutant_is_told_with_its_line_before_and_after() -> None:
    (mutant,) = (mutant for mutant, _ in sample.draw(SOURCES, 4, 5) if mutant.token == "not")
    assert (mutant.line, mutant.before, mutant.after) == (2, "returned = not e < f", "returned =  e < f")


@pytest.mark.parametrize(
    ("file", "folder"),
    [
        ("opir_core/flight/kepler.py", "tests/core/flight"),
        ("opir_core/flight/tables/csv.py", "tests/core/flight"),
        ("plugins/opir_testing/opir_testing/contracts/trackers.py", "tests/contracts"),
        ("opir_core/arrays.py", None),
        ("plugins/opir_trackers/opir_trackers/gating.py", "tests/plugins/trackers"),
        ("plugins/opir_trackers/opir_trackers/imm/histories.py", "tests/plugins/trackers/imm"),
        ("plugins/opir_dsp/opir_dsp/plugin.py", None),
    ],
)
def test_tests_lie_where_their_modules_do(file: str, folder: str | None) -> None:
    assert sample.mirror(file) == (folder and ROOT / folder)


def test_tests_of_the_folder_come_first_and_the_nearest_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
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
    stages = sample.stages_of("opir_core/flight/arc.py", imports_of(tmp_path, files), ["test_x.py::test_y"])
    own = ["tests/core/flight/test_arc.py", "tests/core/flight/test_aiming.py"]
    others = ["tests/core/scene/test_near.py", "tests/core/scene/test_a_far.py"]
    left_out = "--deselect=test_x.py::test_y"
    assert [stage.words() for stage in stages] == [
        ["-m", "not slow", left_out, *own],
        ["-m", "slow", left_out, *own],
        ["-m", "not slow", left_out, *others, *sample.DOCUMENTED],
        ["-m", "slow", left_out, *others],
    ]


def test_imports_are_counted_through_helpers_plugins_and_names_in_strings(tmp_path: Path) -> None:
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


def write(folder: Path, files: dict[str, str]) -> None:
    for name, source in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(source)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "limits_s", "outcome", "told"),
    [
        ("def test_a(): pass", (60, 90), "survived", "all not slow passed"),
        ("def test_a(): assert False", (60, 90), "killed", "FAILED test_a.py::test_a"),
        ("import nothing_of_this_name", (60, 90), "killed", "ERROR test_a.py"),
        ("import time\ndef test_a(): time.sleep(90)", (5, 90), "hang", "no test ended in 5 s"),
        ("import time\ndef test_a(): time.sleep(90)", (60, 5), "survived", "tests left out at the time limit"),
    ],
)
def test_what_tests_say_of_a_mutant(
    tmp_path: Path, source: str, limits_s: tuple[float, float], outcome: str, told: str
) -> None:
    settings = "from hypothesis import settings\nsettings.register_profile('unshrunk', max_examples=1)\n"
    write(
        tmp_path,
        {
            "test_a.py": source,
            "conftest.py": settings,
            "plugins/opir_x/x.py": "",
            "pytest.ini": "[pytest]\nmarkers = slow",
        },
    )
    said, by = sample._outcome(tmp_path, sample.Stage(["test_a.py"], "not slow"), sample.Limits(*limits_s))
    assert said == outcome
    assert by.startswith(told)


@pytest.mark.slow
def test_a_changed_module_is_what_its_tests_import_and_then_is_as_before(tmp_path: Path) -> None:
    """Sizes and times of the sources are the same, so that a stale compiled file would be believed."""
    write(tmp_path, {"opir_a.py": "A = 1\n", "pytest.ini": "[pytest]\npythonpath = .\n"})
    for value in (1, 2, 3):
        sample._write(tmp_path / "opir_a.py", f"A = {value}\n")
        found = sample.subprocess.run(
            [sys.executable, "-c", "import opir_a; print(opir_a.A)"], cwd=tmp_path, capture_output=True, text=True
        )
        assert found.stdout == f"{value}\n"
