"""The report of a run: one file that fetches nothing, with well-formed pictures, its data, and the
same bytes.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pyarrow.parquet
import pytest
from opir_report import INK, map_svg, write_run_report
from opir_report.pages.page import themed
from opir_report.palette import ROLES
from opir_report.run_facts import RunFacts, containment_rings, mapped_rings
from reported_runs import empty_run, example_run, report_page, scored_run

import opir_core
from opir_core.cli.main import main
from opir_core.errors import SinkError

SVG = re.compile(r"<svg.*?</svg>", re.DOTALL)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_run_report(scored_run(), path)
    return path


@pytest.mark.slow
def test_the_page_says_who_saw_what_first(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    row = scored_run().summary["targets"][0]
    assert f"first seen by {row['first_sensor_id']} after {row['latency_s']:.3f} s" in text
    assert text.index("first seen by") < text.index("<svg")


def test_nothing_is_fetched_and_nothing_is_run(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert "<script" not in text
    plain = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    assert not re.findall(r"(?:https?:)?//\w", plain)
    assert not re.findall(r"@import|url\((?!#)", plain)
    links = re.findall(r'(?:href|src)="([^"]*)"', plain)
    assert all(link.startswith("#") or (report.parent / link).is_file() for link in links)


def test_pictures_are_well_formed_and_described(report: Path) -> None:
    pictures = SVG.findall(report.read_text(encoding="utf-8"))
    assert len(pictures) >= 4
    for picture in pictures:
        root = ElementTree.fromstring(picture)
        assert root.get("role") == "img"
        assert len(root.get("aria-label", "")) > 20
    assert report.read_text(encoding="utf-8").count("<figcaption>") == len(pictures)


def test_ids_are_unique_and_references_have_a_target(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    ids = re.findall(r'\sid="([^"]+)"', text)
    assert len(set(ids)) == len(ids)
    assert set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text)) <= set(ids)


def test_every_colour_has_a_value_in_dark_mode(report: Path) -> None:
    for picture in SVG.findall(report.read_text(encoding="utf-8")):
        assert not set(re.findall(r"(?<!, )#[0-9a-f]{6}", picture)) - {"#000000"}
    assert themed(f"fill: {INK}") == f"fill: var(--ink, {INK})"
    assert len({name for name, _ in ROLES.values()}) == len(ROLES)


@pytest.mark.slow
def test_the_data_beside_the_report_are_those_of_its_figures(report: Path) -> None:
    for figure in report_page(scored_run()).figures():
        table = pyarrow.parquet.read_table(report.with_suffix(".data") / f"{figure.name}.parquet")
        assert table.column_names == list(figure.data.columns)
        assert table.num_rows == len(figure.data) > 0


@pytest.mark.slow
def test_a_run_has_one_report_to_the_byte(tmp_path: Path) -> None:
    first, second = (_written_report(tmp_path / seed, seed) for seed in ("77", "78"))
    assert first.read_bytes() == second.read_bytes()
    for path in first.with_suffix(".data").iterdir():
        assert (second.with_suffix(".data") / path.name).read_bytes() == path.read_bytes()


def _written_report(folder: Path, hash_seed: str) -> Path:
    """Return the report that a fresh process writes of a run."""
    folder.mkdir()
    written = folder / "report.html"
    code = (
        "import sys\nfrom pathlib import Path\nfrom opir_report import write_run_report\n"
        "from reported_runs import scored_run\nwrite_run_report(scored_run(), Path(sys.argv[1]))"
    )
    # Another kernel of linear algebra, or number of its threads, rounds otherwise.
    kernel = {name: value for name, value in os.environ.items() if name.startswith("OPENBLAS")}
    environment = {
        **kernel,
        "PYTHONHASHSEED": hash_seed,
        "PYTHONPATH": str(Path(__file__).parents[2] / "support"),
        "PATH": "",
        "MPLCONFIGDIR": str(folder),
    }
    subprocess.run([sys.executable, "-c", code, str(written)], check=True, env=environment)
    return written


@pytest.mark.slow
@pytest.mark.parametrize(
    "run", [empty_run, lambda: example_run("first_light")], ids=["no targets", "no tracker"]
)
def test_runs_that_lack_something_have_a_report_too(run, tmp_path: Path) -> None:
    (written,) = write_run_report(run(), tmp_path / "report.html", with_data=False)
    text = written.read_text(encoding="utf-8")
    assert ".parquet" not in text
    assert all(ElementTree.fromstring(picture) is not None for picture in SVG.findall(text))


@pytest.mark.slow
def test_a_notebook_shows_the_map() -> None:
    svg = map_svg(scored_run())
    ElementTree.fromstring(svg)
    assert svg in scored_run()._repr_html_()


@pytest.mark.slow
def test_the_command_writes_the_report_of_files(tmp_path: Path, monkeypatch, capsys) -> None:
    from repository import EXAMPLES

    monkeypatch.chdir(tmp_path)
    assert main(["run", str(EXAMPLES / "first_light.yaml"), "--quiet"]) == 0
    assert main(["report", "events.jsonl", "-o", "here.html"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "here.html: report"
    assert (tmp_path / "here.data" / "launches.parquet").is_file()
    assert main(["report", ".", "--no-data"]) == 0
    assert {path.name for path in tmp_path.glob("report*")} == {"report.html"}


def test_a_path_without_a_report_gets_one_message(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["report", "scene.yaml"]) == 2
    assert "run it first, `opir run scene.yaml`" in capsys.readouterr().err
    assert main(["report", "events.jsonl"]) == 2
    assert "events" in capsys.readouterr().err
    assert main(["report", "events.jsonl", "-o", str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


@pytest.mark.slow
def test_a_report_that_cannot_be_written_says_why(tmp_path: Path) -> None:
    with pytest.raises(SinkError, match="create the folder"):
        write_run_report(scored_run(), tmp_path / "nowhere" / "report.html")
    (tmp_path / "report.data").write_text("a file where the folder should be")
    with pytest.raises(SinkError, match="is a file; give the path of a folder"):
        write_run_report(scored_run(), tmp_path / "report.html")


@pytest.mark.slow
def test_regions_that_would_cover_the_map_are_left_out() -> None:
    run = opir_core.simulate(opir_core.example("pacific", overrides=["duration_s=100"]))
    facts = RunFacts(run)
    areas = [
        list(containment_rings(run.tracks, row).values())[-1].area_km2
        for row in facts.last_with_impact.values()
    ]
    assert min(areas) > 5e6
    assert [mapped_rings(run.tracks, row) for row in facts.last_with_impact.values()] == [None] * 3
    texts = [text.get_text() for text in run.plot.map().get_legend().get_texts()]
    assert "over 5 million km²: not drawn" in texts
