"""What a paper needs of a study: a paragraph on the method, a citation, and the end of every caption."""

from attrs import evolve

from opir_core.cli import grouped
from opir_report.pages.page import ReportFigure, ReportSection, ReportTable
from opir_report.saved_study import SavedStudy

_BIBTEX = (
    "@software{{opir, title = {{opir: a plugin-based simulator of overhead infrared missile-warning"
    " sensors}}, author = {{{{The opir authors}}}}, version = {{{version}}}, license ="
    " {{Apache-2.0}}}}"
)


def citing_section(study: SavedStudy) -> ReportSection | None:
    """Return the section, or None for a study that does not hold the versions that made it."""
    versions = study.definition.get("versions", {})
    if not versions:
        return None
    rows = [
        ("citation (BibTeX)", _BIBTEX.format(version=versions.get("opir-core", ""))),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions.items())),
        ("random numbers", str(study.definition.get("random_numbers", ""))),
    ]
    table = ReportTable("Ready to paste", ("", "text"), rows)
    return ReportSection("citing", "For a paper", method_paragraph(study), (table,))


def method_paragraph(study: SavedStudy) -> str:
    """Return how the study was made, in sentences."""
    definition = study.definition
    designs = len(definition["designs"])
    launches = study.launches
    of = "" if launches is None else f" with {grouped(len(launches))} launches"
    split = f" in the conditions {', '.join(map(str, _levels(study)))}" if study.split else ""
    version = definition.get("versions", {}).get("opir-core", "")
    return (
        f"The scene {definition['scene']} was simulated with opir {version} for {designs}"
        f" combinations of {study.names(study.choices) or 'nothing'}{split}: {_runs_text(study)}{of}."
        " Run k has the same random numbers in all of them, so differences are paired. Intervals are"
        " 95 %: Student's t over runs for means, exact binomial intervals of the effective number of"
        " launches (Korn and Graubard, 1998) for shares. Sensors, target classes and sites are"
        " notional."
    )


def _levels(study: SavedStudy) -> list[str]:
    rows = study.rows(next(iter(study.units)))
    return list(dict.fromkeys(study.short_labels(rows, [study.split])))


def _runs_text(study: SavedStudy) -> str:
    """Return the number of runs of a design and their seeds: `36 runs of each, seeds 1 to 36`."""
    rows = study.rows(next(iter(study.units)))
    counts = sorted(set(rows["runs"].tolist()))
    runs = " to ".join(grouped(int(count)) for count in dict.fromkeys((counts[0], counts[-1])))
    return (
        f"{runs} runs of each, seeds {int(rows['first_seed'].min())} to"
        f" {int(rows['last_seed'].max())}"
    )


def provenance(study: SavedStudy) -> str:
    """Return the numbers of runs, the seeds and the version of a study."""
    version = study.definition.get("versions", {}).get("opir-core", "")
    runs = _runs_text(study)
    return f"{runs[0].upper()}{runs[1:]}{f'; opir {version}' if version else ''}."


def with_provenance(section: ReportSection, words: str) -> ReportSection:
    """Return a section whose captions end with the provenance of what they show."""

    def captioned(part: ReportFigure | ReportTable) -> ReportFigure | ReportTable:
        if isinstance(part, ReportTable):
            return part
        return evolve(part, caption=f"{part.caption.rstrip('. ')}. {words}")

    return evolve(section, parts=[captioned(part) for part in section.parts])
