"""`opir optimise`: find the best design under requirements, and print it with those that come
next.
"""

import argparse
import json
import sys
from pathlib import Path

from opir_core.cli import grouped, table
from opir_studies.optimising import Objective, Optimised, best_row, optimise as best_of, outcome_of
from opir_studies.refusals import require_positive
from opir_studies.requirements import FigureRequirement
from opir_studies.result_words import cell, share_lines
from opir_studies.search import Outcome
from opir_studies.sweep_command import study_of, watched_runs

#: The designs that are printed.
_ROWS = 5


def optimise(arguments: argparse.Namespace) -> int:
    """Find the best design and print it; exit code 2 where no design meets the requirements."""
    study = study_of(arguments)
    require_positive("--evaluations", arguments.evaluations, "designs")
    folder = Path(arguments.out or f"{Path(arguments.study).stem}-optimum")
    with watched_runs(arguments, folder) as on_progress:
        optimised = best_of(
            study,
            folder,
            arguments.objective,
            evaluations=arguments.evaluations,
            workers=arguments.workers,
            dead_after_s=arguments.dead_after,
            on_progress=on_progress,
        )
    if not arguments.quiet:
        sys.stdout.write((as_json(optimised) if arguments.json else as_text(optimised)) + "\n")
    return 0 if optimised.is_feasible else 2


def as_text(optimised: Optimised) -> str:
    """Return the best design in a sentence, and a table of the best ones."""
    result = optimised.result
    objective = result.definition["objective"]
    requirements = [
        FigureRequirement(**requirement) for requirement in result.definition["requirements"]
    ]
    figures = list(
        dict.fromkeys([objective["figure"], *(requirement.figure for requirement in requirements)])
    )
    rows = {name: result.shown_rows(name) for name in figures}

    def rank(number: int) -> Outcome:
        means, shares = (
            {name: figure_rows[number][key] for name, figure_rows in rows.items()}
            for key in ("mean", "share")
        )
        return outcome_of(means, shares, requirements, Objective(**objective))

    order = sorted(range(len(result.definition["designs"])), key=rank)[:_ROWS]
    body = [
        [
            *(str(rows[figures[0]][number][path]) for path in result.paths),
            *(cell(rows[name][number]) for name in figures),
        ]
        for number in order
    ]
    words = ", ".join(f"{path}={value}" for path, value in best_row(optimised).items())
    extreme = "largest" if objective["is_largest"] else "smallest"
    lack = (
        ""
        if optimised.is_feasible
        else "; no design that was evaluated meets all requirements and has these figures in all"
        " launches, this one is nearest"
    )
    count = (
        f"{grouped(len(result.definition['designs']))} of {grouped(optimised.possible)} designs"
        f" evaluated"
    )
    return "\n\n".join(
        [
            *map("note: {}".format, result.definition["notes"]),
            (
                f"{extreme} {objective['figure']}: {words} ({count}, the best at evaluation"
                f" {optimised.best + 1}){lack}"
            ),
            table([*result.paths, *figures], body),
            *share_lines(result, figures),
            (
                f"All designs: {result.folder / 'results.csv'}; opir report {result.folder} draws the"
                f" path"
            ),
        ]
    )


def as_json(optimised: Optimised) -> str:
    """Return the best design as JSON."""
    rows = [row for row in optimised.result.table.to_pylist() if row["design"] == optimised.best]
    means, shares = (
        {row["figure"]: row[key] if row[key] == row[key] else None for row in rows}
        for key in ("mean", "share")
    )
    document = {
        "best": best_row(optimised),
        "means": means,
        "shares": shares,
        "is_feasible": optimised.is_feasible,
        "evaluation": optimised.best + 1,
        "evaluations": len(optimised.result.definition["designs"]),
        "possible": optimised.possible,
    }
    return json.dumps(document, indent=2)
