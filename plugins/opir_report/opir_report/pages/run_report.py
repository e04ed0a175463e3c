"""The report of a run: sentences first, then maps, detections, tracks and impacts, each with its
data.
"""

from pathlib import Path

from opir_core import Run
from opir_core.cli import answers, grouped
from opir_report.pages.citing_section import with_provenance
from opir_report.pages.files import write_page
from opir_report.pages.page import ReportPage
from opir_report.pages.run_sections import SECTIONS
from opir_report.run_plots import RunPlots


def write_run_report(run: Run, path: Path, *, with_data: bool = True) -> list[Path]:
    """Write the report of a run; return the files written.

    The data of each figure are written as Parquet into a folder beside the report, `report.data`
    for `report.html`. Raises `SinkError` where a file cannot be written.
    """
    return write_page(run_page(run), path, with_data=with_data)


def report_of(run: Run, path: str | Path = "report.html") -> Path:
    """Write the report of a run without data, and return its path; raises as `write_run_report`."""
    return write_run_report(run, Path(path), with_data=False)[0]


def run_page(run: Run) -> ReportPage:
    """Return the page of a run."""
    plots = RunPlots(run)
    counts = run.summary["counts"]
    versions = run.manifest["versions"]
    scene = run.plan.scene
    names = ("sensors", "targets", "detections", "looks", "tracks")
    totals = ", ".join(
        f"{grouped(counts[name])} {name.removesuffix('s') if counts[name] == 1 else name}"
        for name in names
    )
    subtitle = f"{totals}; {scene.duration_s:g} s, seed {scene.seed}"
    return ReportPage(
        title=f"Run of {scene.name}",
        subtitle=subtitle,
        summary=answers(run.summary),
        sections=[
            with_provenance(section, f"One run, seed {scene.seed}; opir {versions['opir-core']}.")
            for make in SECTIONS
            if (section := make(plots)) is not None
        ],
        footer="Written by opir-report. Unclassified textbook physics, notional numbers.",
    )
