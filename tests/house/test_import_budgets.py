"""A scene pays only for what it names: which modules a process imports, counted. Budgets only
fall.
"""

import json
import subprocess
import sys

import pytest
from repository import EXAMPLES, TEST_SCENES

#: How many modules more than bare Python `opir --version` may import.
VERSION_BUDGET = 30

#: What a first run is compared with. Editable installations import `__future__` and `pathlib` at
#: start.
BASELINE = "import __future__, numpy, pathlib"

#: How many modules more than `BASELINE` a first run may import, two of them opir-render: files are
#: put in place together; work, ranges, input files, plugins and columns are checked; described
#: light and settings that nothing reads are looked for; results can show themselves; versions of
#: formats are stated; faults are read; what sensors looked at is stated; rare parts have one module
#: that finds theirs.
FIRST_RUN_BUDGET = 287

#: How many classes attrs may build for a first run: each costs half a millisecond.
CLASSES_BUDGET = 174

HEAVY = (
    "scipy",
    "litestar",
    "aiokafka",
    "matplotlib",
    "pyarrow",
    "rich",
    "pyproj",
    "sgp4",
    "pandas",
    "numba",
)


def modules_of(code, folder):
    """Return the modules a fresh process has imported after running some code."""
    reported = f"{code}\nimport sys, json\nprint(json.dumps(sorted(sys.modules)), file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", reported], cwd=folder, capture_output=True, text=True, check=True
    )
    return set(json.loads(done.stderr.splitlines()[-1]))


def command(*words):
    return (
        "from opir_core.cli.main import main\n"
        f"try:\n    code = main({list(words)!r})\nexcept SystemExit as stop:\n    code ="
        f" stop.code\n"
        "assert not code, code\n"
    )


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    return modules_of("", tmp_path_factory.mktemp("bare"))


def test_version_stays_within_its_budget(tmp_path, bare):
    extra = modules_of(command("--version"), tmp_path) - bare
    assert len(extra) <= VERSION_BUDGET, sorted(extra)
    assert not {
        name
        for name in extra
        if name.split(".")[0] in {"numpy", "attrs", "attr", "pluggy", "yaml", "cattrs"}
    }


def test_importing_the_package_imports_no_part_of_it(tmp_path, bare):
    extra = modules_of("import opir_core", tmp_path) - bare
    assert {name for name in extra if name.startswith("opir_core")} == {
        "opir_core",
        "opir_core.doors",
    }


@pytest.mark.slow
def test_a_first_run_stays_within_its_budget(tmp_path):
    baseline = modules_of(BASELINE, tmp_path)
    scene = str(EXAMPLES / "first_light.yaml")
    extra = modules_of(command("run", scene, "--quiet"), tmp_path) - baseline
    assert len(extra) <= FIRST_RUN_BUDGET, sorted(extra)


def test_a_first_run_builds_few_classes(tmp_path):
    counted = (
        "import sys\n"
        "own = {each for name, module in list(sys.modules.items()) if name.startswith('opir_')"
        " for each in vars(module).values() if isinstance(each, type) and '__attrs_attrs__' in"
        " vars(each)}\n"
        f"assert 100 < len(own) <= {CLASSES_BUDGET}, len(own)"
    )
    modules_of(command("run", str(EXAMPLES / "first_light.yaml"), "--quiet") + counted, tmp_path)


def test_a_scene_that_names_only_dsp_imports_no_other_constellation_and_nothing_heavy(
    tmp_path,
):
    loaded = modules_of(command("run", str(EXAMPLES / "first_light.yaml"), "--quiet"), tmp_path)
    roots = {name.split(".")[0] for name in loaded}
    assert "opir_dsp" in roots
    others = {
        "opir_sbirs",
        "opir_nextgen",
        "opir_heo",
        "opir_leo",
        "opir_http",
        "opir_displays",
        "opir_kafka",
        "opir_stonesoup",
    }
    others |= {
        "opir_export",
        "opir_paper",
        "opir_readers",
        "opir_report",
        "opir_scoring",
        "opir_studies",
        "opir_dask",
        "opir_bench",
    }
    assert not roots & {*others, "opir_coverage", "stonesoup", "xarray"}
    assert not roots & set(HEAVY)


@pytest.mark.slow
def test_constant_detection_imports_no_radiometry(tmp_path):
    loaded = modules_of(
        command(
            "run", str(TEST_SCENES / "pacific_test_range.yaml"), "--tracker", "none", "--quiet"
        ),
        tmp_path,
    )
    assert not {name for name in loaded if name.startswith("opir_photons.radiometry")}


@pytest.mark.slow
def test_a_kepler_scene_imports_no_numerical_propagation(tmp_path):
    loaded = modules_of(
        command(
            "run", str(TEST_SCENES / "pacific_test_range.yaml"), "--tracker", "none", "--quiet"
        ),
        tmp_path,
    )
    heavier = {"forces", "propagation", "integration", "gravity_and_drag", "dop853"}
    assert not {f"opir_core.flight.{name}" for name in heavier} & loaded


@pytest.mark.slow
@pytest.mark.parametrize("sink", ["memory", "null"])
def test_a_sink_that_encodes_nothing_imports_no_encoder(tmp_path, sink):
    scene = str(EXAMPLES / "first_light.yaml")
    loaded = modules_of(command("run", scene, "--sink", sink, "--quiet"), tmp_path)
    assert "msgspec" not in loaded
    assert "opir_core.output.events.forge" not in loaded


def test_events_and_truth_of_a_run_become_parquet_without_pandas(tmp_path):
    outputs = "outputs=[{parquet: {path: events.parquet}}]"
    words = (
        "run",
        str(EXAMPLES / "first_light.yaml"),
        "--set",
        outputs,
        "--truth",
        "truth.parquet",
        "--quiet",
    )
    loaded = modules_of(command(*words), tmp_path)
    assert "pyarrow" in loaded
    assert not {"pandas", "polars"} & loaded
