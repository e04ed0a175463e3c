"""The suite of benchmarks: every script is in it and runs at small size; figures are read, kept and
compared.
"""

import argparse
import ast
import importlib
import json
import sys

import numpy as np
import pytest
from repository import ROOT

sys.path.insert(0, str(ROOT))
from benchmarks import __main__ as command, pages
from benchmarks.figures import figures_in, keep, kept_figures, number_of, ratios
from benchmarks.registry import BENCHMARKS, Benchmark
from benchmarks.suite import attempt, summary


@pytest.mark.slow
@pytest.mark.parametrize("benchmark_", BENCHMARKS, ids=[benchmark.name for benchmark in BENCHMARKS])
def test_every_benchmark_runs_at_small_size(benchmark_):
    if missing := list(benchmark_.missing()):
        pytest.skip(f"needs {', '.join(missing)}")
    result = attempt(benchmark_, quick=True)
    assert result.problem == "", result.output
    assert result.figures
    assert result.processor_s > 0.0


def test_every_script_is_in_the_suite():
    scripts = {
        path.relative_to(ROOT / "benchmarks").as_posix()
        for path in (ROOT / "benchmarks").rglob("*.py")
        if path.name != "__main__.py" and has_main(path)
    }
    assert scripts == {benchmark.script for benchmark in BENCHMARKS}
    assert len({benchmark.name for benchmark in BENCHMARKS}) == len(BENCHMARKS)


def has_main(path):
    return any(
        isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)
        for node in ast.parse(path.read_text("utf-8")).body
    )


def test_what_cannot_run_is_left_out_and_named(monkeypatch, capsys):
    lacking = Benchmark(
        "lacking", "?", "startup.py", (), needs=("no_such_module",), programs=("no-such-program",)
    )
    monkeypatch.setattr(command, "BENCHMARKS", (lacking,))
    assert command.main(["--quick"]) == 0
    assert "lacking: left out, needs no_such_module, no-such-program" in capsys.readouterr().out


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(SystemExit, match="no benchmark 'throughptu': throughput"):
        command.main(["--only", "throughptu"])


def test_peers_that_are_not_installed_are_left_out_of_tables_and_named(monkeypatch, capsys):
    monkeypatch.setattr(pages, "find_spec", lambda name: None if name == "filterpy" else name)
    names = ["imm, 1 s", "Stone Soup EKF, jerk, 1 s", "FilterPy EKF, acceleration, 1 s"]
    assert pages.installed(names) == names[:2]
    assert "FilterPy: left out, not installed" in capsys.readouterr().err
    assert pages.left_out(names[:2]) == "\nLeft out, because not installed: FilterPy.\n"
    assert pages.shown(float("nan"), ".1f") == "–"


def test_a_page_is_written_again_from_its_data(tmp_path):
    rows = [{"name": "a, b", "count": 2, "share": 0.25, "gap": float("nan")}]
    table = pages.Table(rows)

    def page(stored):
        (row,) = stored.where(name="a, b")
        return f"{row['count']} {row['share']} {stored.facts['runs']}"

    for options in ({"write": tmp_path, "from_csv": None}, {"write": None, "from_csv": tmp_path}):
        arguments = argparse.Namespace(**options)
        measured = table if options["write"] else None
        pages.publish(arguments, page, None, {"runs": 3}, data=measured)
        assert (tmp_path / "data.md").read_text("utf-8") == "2 0.25 3"
    assert np.isnan(pages.read_csv(tmp_path / "data.csv").column("gap")).all()


def test_figures_are_named_by_the_text_and_the_first_number_of_their_row(tmp_path):
    tmp_path.joinpath("arcs.csv").write_text(
        "# a: fact\nway,step,error\nA,1,0.5\nA,2,0.25\n", encoding="utf-8"
    )
    result = figures_in(tmp_path)
    assert result["arcs: A 1: error"] == 0.5
    assert result["arcs: A 2: error"] == 0.25


def test_pages_are_read_where_there_is_no_csv_file(tmp_path):
    tmp_path.joinpath("page.md").write_text(
        "# P\n\n| way | events/s |\n|---|---|\n| A | **12 300** |\n", "utf-8"
    )
    assert figures_in(tmp_path) == {"page: A: events/s": 12300.0}


@pytest.mark.parametrize(
    ("cell", "value"),
    [
        ("3", 3.0),
        ("−1.5e-3", -1.5e-3),
        ("1 234 567", 1234567.0),
        ("9 [8, 10]", 9.0),
        ("50 %", 50.0),
        ("2-body", None),
        ("–", None),
    ],
)
def test_numbers_of_cells(cell, value):
    assert number_of(cell) == value


def test_scripts_keep_figures_only_for_the_suite(tmp_path, monkeypatch):
    monkeypatch.delenv("OPIR_BENCHMARK_FIGURES", raising=False)
    keep("plan", 1.0, "ms")
    monkeypatch.setenv("OPIR_BENCHMARK_FIGURES", str(tmp_path / "kept"))
    keep("plan", 2.0, "ms")
    assert kept_figures(tmp_path / "kept") == {"plan, ms": 2.0}


def test_results_are_medians_of_rounds_and_are_compared(tmp_path, monkeypatch, capsys):
    counting = tmp_path / "counting.py"
    counting.write_text(
        "import json, os, pathlib\n"
        f"log = pathlib.Path({str(tmp_path / 'log')!r}); log.open('a').write('x'); n ="
        f" len(log.read_text())\n"
        "pathlib.Path(os.environ['OPIR_BENCHMARK_FIGURES']).write_text(json.dumps(['n',"
        " float(n)]))\n",
        encoding="utf-8",
    )
    monkeypatch.setattr(
        command, "BENCHMARKS", (Benchmark("counting", "?", str(counting), (), writes=False),)
    )
    assert command.main(["--rounds", "3", "--json", str(tmp_path / "one.json")]) == 0
    results = json.loads((tmp_path / "one.json").read_text("utf-8"))
    assert results["benchmarks"]["counting"]["figures"] == {"n": 2.0}
    assert results["machine"]["versions"]["numpy"]
    capsys.readouterr()
    assert command.main(["--rounds", "1", "--against", str(tmp_path / "one.json")]) == 0
    assert "2.000  n: 4" in capsys.readouterr().out


def test_a_failed_benchmark_is_named_with_its_reason(tmp_path):
    broken = tmp_path / "broken.py"
    broken.write_text("raise SystemExit('no sun')\n", encoding="utf-8")
    benchmark_ = Benchmark("broken", "?", str(broken), (), writes=False)
    assert (
        summary(benchmark_, [attempt(benchmark_, quick=True)])["problem"] == "exit code 1: no sun"
    )


def test_ratios_leave_out_what_only_one_has():
    assert ratios({"a": 3.0, "b": 1.0, "c": 1.0}, {"a": 2.0, "c": 0.0}) == {"a": 1.5}


@pytest.mark.parametrize(("power", "start"), [(1.0, 0.0), (1.0, 0.9), (2.0, 0.5), (0.5, 0.02)])
def test_the_exponent_of_a_power_law_above_a_start_is_found(power, start, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    complexity = importlib.import_module("complexity")
    value = np.logspace(1.0, 4.0, 7)
    assert complexity.exponent(value, start + 1e-3 * value**power) == pytest.approx(power, abs=0.05)
    assert complexity.exponent(value, np.full(7, 3.0)) == 0.0


def test_a_level_that_beats_a_default_is_named(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    end_to_end = importlib.import_module("end_to_end")

    def row(level, default, time, error):
        knob = {"scene": "one", "knob": "light time", "level": level, "default": default}
        return knob | {"processor_s": time, "line_of_sight_urad": error}

    default = row("on", 1, 2.0, 0.0)
    assert end_to_end.off_the_knee([default, row("off", 0, 1.0, 5.0)]) == []
    rival = row("on too", 0, 1.0, 0.0)
    assert end_to_end.off_the_knee([default, rival]) == ["light time on too in `one`"]
