"""From an empty cell: an example, a run with progress, its files, report and scores."""

import filecmp
import sys
import tomllib
from types import SimpleNamespace

import pytest
from repository import EXAMPLES

import opir_core as opir
from opir_core.cli.main import main
from opir_core.notebook import progress

SHORT = ["duration_s=30", "tracker=imm"]
KINDS = ("jsonl", "truth.jsonl", "tracks.jsonl")


def test_every_example_of_the_folder_is_there_by_the_beginning_of_its_name():
    for path in EXAMPLES.glob("*.yaml"):
        assert opir.example(path.stem) == opir.load_scene(path)
    pacific = opir.example("pacific", overrides=["duration_s=200"])
    assert (pacific.name, pacific.duration_s) == ("pacific-test-range", 200.0)


@pytest.mark.parametrize("name", ["", "atlantic", "p"])
def test_another_name_lists_the_examples(name):
    with pytest.raises(opir.SceneError, match=f"'{name}' is not the name of one; .*first_light"):
        opir.example(name)


def test_a_wheel_has_the_examples():
    settings = tomllib.loads((EXAMPLES.parent / "pyproject.toml").read_text(encoding="utf-8"))
    files = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert files == {
        f"examples/{path.name}": f"opir_core/examples/{path.name}"
        for path in EXAMPLES.glob("*.yaml")
    }


@pytest.mark.slow
def test_a_saved_run_is_that_of_the_command_byte_for_byte(tmp_path):
    run = opir.simulate(opir.example("first", overrides=SHORT))
    assert run.save(tmp_path / "saved.jsonl") == tmp_path / "saved.jsonl"
    settings = [word for setting in SHORT for word in ("--set", setting)]
    path = str(tmp_path / "typed.jsonl")
    assert main(["run", str(EXAMPLES / "first_light.yaml"), *settings, "--out", path, "-q"]) == 0
    for kind in KINDS:
        assert filecmp.cmp(tmp_path / f"saved.{kind}", tmp_path / f"typed.{kind}", shallow=False)
    loaded = opir.load_run(tmp_path / "saved.jsonl")
    typed = opir.load_run(tmp_path / "typed.jsonl")
    assert loaded.summary == typed.summary
    assert loaded.manifest["counts"] == typed.manifest["counts"]
    with pytest.raises(opir.SinkError, match=r"was read from files.*copy the files"):
        loaded.save(tmp_path / "again.jsonl")


@pytest.mark.slow
def test_a_run_scores_and_reports_itself(tmp_path, capsys):
    run = opir.simulate(opir.example("first", overrides=SHORT))
    assert run.score(bin_s=10.0).figures["runs"] == 1
    with pytest.raises(TypeError, match="bins_s"):
        run.score(bins_s=10.0)
    page = run.report(tmp_path / "run.html")
    assert "<svg" in page.read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["run.html"]
    assert capsys.readouterr().out == ""


class Cell:
    """Stands in for IPython with a kernel, and for its display."""

    def __init__(self):
        self.shown = []

    def get_ipython(self):
        return SimpleNamespace(kernel=self)

    def HTML(self, text):  # noqa: N802
        return text

    def display(self, text, *, display_id):
        assert display_id
        self.shown.append(text)
        return self

    def update(self, text):
        self.shown.append(text)


def test_progress_in_a_cell_is_one_bar_that_moves(monkeypatch):
    cell = Cell()
    monkeypatch.setitem(sys.modules, "IPython", cell)
    monkeypatch.setitem(sys.modules, "IPython.display", cell)
    opir.simulate(opir.example("first", overrides=["duration_s=20"]), progress=True)
    assert cell.shown[0].startswith('<progress value="0.4" max="20"></progress> first-light, s')
    assert cell.shown[-1].startswith('<progress value="20" max="20">')
    assert len(cell.shown) >= 50


def test_progress_in_a_terminal_is_on_standard_error(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress(is_shown=True) as update:
        update("runs", 3.0, 4.0)
    with progress(is_shown=False) as update:
        update("silent", 3.0, 4.0)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "runs" in shown.err
    assert "silent" not in shown.err


def test_progress_changes_no_result():
    scene = opir.example("first", overrides=["duration_s=20"])
    plain = opir.simulate(scene)
    shown = opir.simulate(scene, progress=True)
    assert (plain.detections.time_ns == shown.detections.time_ns).all()
    assert plain.summary == shown.summary
