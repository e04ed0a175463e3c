"""The shares of launches that a study requires: a row per requirement and design, over all
conditions, in each, and by site and class.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen
from opir_scoring import TAILS_95, LaunchShare, Tails, verdict_in_all

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_studies.launches import FACTS
from opir_studies.planning import PlannedStudy
from opir_studies.runs import RunRecord
from opir_studies.share_requirements import ShareRequirement
from opir_studies.until import DECIDED, rounds

#: The condition of rows over all conditions.
ALL_CONDITIONS = "all"

#: The columns of `share_rows`, with their types.
SHARE_COLUMNS: Mapping[str, str] = {
    "requirement": "string",
    "required": "float64",
    "condition": "string",
    "by": "string",
    "value": "string",
    "launches": "int64",
    "runs": "int64",
    "share": "float64",
    "low": "float64",
    "high": "float64",
    "verdict": "string",
    "deciding_runs": "int64",
}

Records = Sequence[Sequence[RunRecord | None]]


@frozen(eq=False)
class LaunchRows:
    """Values (n,) of a column of launches that they apply to, with run and facts of each.

    Runs of different conditions with one number have the same seed, and are one unit.
    """

    values: FloatArray
    run: IntArray
    facts: Mapping[str, Sequence[str]]

    @classmethod
    def of(
        cls, planned: PlannedStudy, records: Records, designs: Sequence[int], column: str
    ) -> "LaunchRows":
        """Return the rows of some designs, by their numbers."""
        place = list(planned.launch_units).index(column)
        rows = [
            (value, run.replicate, *facts)
            for design in designs
            for run in filter(None, records[design])
            for value, facts in zip(
                run.launches[place], planned.designs[design].launches, strict=True
            )
        ]
        values = np.array([row[0] for row in rows], dtype=np.float64)
        runs = np.array([row[1] for row in rows], dtype=np.int64)
        names = np.array([row[2:] for row in rows], dtype=object).reshape(-1, len(FACTS))
        applies = ~np.isnan(values)
        facts = dict(zip(FACTS, names[applies].T, strict=True))
        return cls(values[applies], runs[applies], facts)

    def share(self, requirement: ShareRequirement, rows: BoolArray | slice = slice(None)) -> Any:
        """Return the share of some rows that are within the limit of a requirement."""
        return LaunchShare.of(requirement.is_met(self.values[rows]), self.run[rows])


def tails_of(planned: PlannedStudy, conditions: int = 1) -> Tails:
    """Return the tails of the intervals that decide: 2.5 % over all times at which a study may
    stop, and above an interval over all conditions too.
    """
    study = planned.study
    looks = len(list(rounds(study.runs, stops_early=study.until == DECIDED)))
    tail = TAILS_95.low / looks
    return Tails(tail, tail / conditions)


def verdict_of(
    planned: PlannedStudy, requirement: ShareRequirement, records: Records, group: Sequence[int]
) -> str:
    """Return the verdict on a requirement of the designs of a group, which differ in conditions."""
    if not requirement.in_every_condition:
        rows = LaunchRows.of(planned, records, group, requirement.column)
        return str(rows.share(requirement).verdict(requirement.share, tails_of(planned)))
    tails = tails_of(planned, len(group))
    shares = [
        LaunchRows.of(planned, records, [design], requirement.column).share(requirement)
        for design in group
    ]
    return verdict_in_all([share.verdict(requirement.share, tails) for share in shares])


def share_rows(planned: PlannedStudy, records: Records) -> list[tuple[int, dict[str, Any]]]:
    """Return the first design of a group, and the row, of each share.

    A row has `requirement`, `required`, `condition`, `by`, `value`, `launches`, `runs`, `share`,
    `low`, `high`, `verdict` and `deciding_runs`. Rows by site and class have no verdict.
    """
    return [
        (group[0], {"requirement": each.text, "required": each.share, **row})
        for each in planned.share_requirements
        for group in planned.groups
        for row in _rows_of_group(planned, each, records, group)
    ]


def _rows_of_group(
    planned: PlannedStudy, requirement: ShareRequirement, records: Records, group: Sequence[int]
) -> Iterator[dict[str, Any]]:
    rows = LaunchRows.of(planned, records, group, requirement.column)
    verdict = verdict_of(planned, requirement, records, group)
    tails = tails_of(planned)
    each_tails = tails_of(planned, len(group)) if requirement.in_every_condition else tails
    in_each = []
    if planned.study.conditions:
        for design in group:
            of_design = LaunchRows.of(planned, records, [design], requirement.column)
            share = of_design.share(requirement)
            in_each.append(_row(share, requirement, each_tails, condition_of(planned, design)))
    share = rows.share(requirement)
    deciding = share.deciding_runs(requirement.share, tails)
    if requirement.in_every_condition:
        undecided = [row["deciding_runs"] for row in in_each if row["verdict"] == "not shown"]
        deciding = None if None in undecided else max(undecided, default=share.runs)
    over_all = _row(share, requirement, tails, ALL_CONDITIONS)
    yield {**over_all, "verdict": verdict, "deciding_runs": deciding}
    yield from in_each
    for fact in FACTS[1:]:
        names = rows.facts[fact]
        for name in dict.fromkeys(names) if len(set(names)) > 1 else ():
            part = rows.share(requirement, np.asarray(names == name))
            row = _row(part, requirement, tails, ALL_CONDITIONS)
            yield {**row, "by": fact, "value": name, "verdict": "", "deciding_runs": None}


def _row(
    share: LaunchShare, requirement: ShareRequirement, tails: Tails, condition: str
) -> dict[str, Any]:
    low, high = share.interval(tails)
    return {
        "condition": condition,
        "by": "",
        "value": "",
        "launches": share.launches,
        "runs": share.runs,
        "share": share.share,
        "low": low,
        "high": high,
        "verdict": share.verdict(requirement.share, tails),
        "deciding_runs": share.deciding_runs(requirement.share, tails),
    }


def condition_of(planned: PlannedStudy, design: int) -> str:
    """Return the conditions of a design in words, `night, overcast`."""
    levels = planned.designs[design].design.levels[len(planned.study.vary) :]
    return ", ".join(str(level.label) for level in levels)
