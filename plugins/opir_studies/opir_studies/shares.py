"""The shares of launches that a study requires: a row per requirement and design, over all
conditions, in each, and by site and class.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from attrs import frozen
from opir_scoring import TAILS_95, LaunchShare, Tails, verdict_in_all

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_studies.launches import FACTS
from opir_studies.planning import PlannedStudy
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


class LaunchColumns(Protocol):
    """What shares are counted from: the finished runs of designs."""

    def numbers(self, design: int) -> IntArray:
        """Return the numbers of a design's runs (n,)."""

    def launch_values(self, design: int, column: str) -> FloatArray:
        """Return a column of the launches of a design's runs (n, launches)."""


@frozen(eq=False)
class LaunchRows:
    """Values (n,) of a column of launches that they apply to, with run and facts of each.

    Runs of different conditions with one number have the same seed, and are one unit.
    """

    values: FloatArray
    run: IntArray
    #: The number of each value's launch in `names`.
    launch: IntArray
    #: Id, class and site of launches.
    names: Sequence[tuple[str, ...]]

    @classmethod
    def of(
        cls, planned: PlannedStudy, runs: LaunchColumns, designs: Sequence[int], column: str
    ) -> "LaunchRows":
        """Return the rows of some designs, by their numbers."""
        names = dict[tuple[str, ...], int]()
        columns = []
        for design in designs:
            facts = planned.designs[design].launches
            values = runs.launch_values(design, column)
            numbers = [names.setdefault(each, len(names)) for each in facts]
            run, place = np.nonzero(~np.isnan(values))
            launch = np.array(numbers, dtype=np.int64)[place]
            columns.append((values[run, place], runs.numbers(design)[run], launch))
        values, run, launch = map(np.concatenate, zip(*columns, strict=True))
        return cls(values, run, launch, tuple(names))

    def parts(self, fact: str) -> Iterator[tuple[str, BoolArray]]:
        """Yield each value of a fact and which rows (n,) have it, where there are several."""
        place = FACTS.index(fact)
        of_names = np.array([names[place] for names in self.names], dtype=np.object_)
        present = np.zeros(len(self.names), np.bool_)
        present[self.launch] = True
        values = dict.fromkeys(of_names[present])
        for value in values if len(values) > 1 else ():
            yield value, np.asarray(of_names == value)[self.launch]

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
    planned: PlannedStudy, requirement: ShareRequirement, runs: LaunchColumns, group: Sequence[int]
) -> str:
    """Return the verdict on a requirement of the designs of a group, which differ in conditions."""
    if not requirement.in_every_condition:
        rows = LaunchRows.of(planned, runs, group, requirement.column)
        return str(rows.share(requirement).verdict(requirement.share, tails_of(planned)))
    tails = tails_of(planned, len(group))
    shares = [
        LaunchRows.of(planned, runs, [design], requirement.column).share(requirement)
        for design in group
    ]
    return verdict_in_all([share.verdict(requirement.share, tails) for share in shares])


def share_rows(planned: PlannedStudy, runs: LaunchColumns) -> list[tuple[int, dict[str, Any]]]:
    """Return the first design of a group, and the row, of each share.

    A row has `requirement`, `required`, `condition`, `by`, `value`, `launches`, `runs`, `share`,
    `low`, `high`, `verdict` and `deciding_runs`. Rows by site and class have no verdict.
    """
    return [
        (group[0], {"requirement": each.text, "required": each.share, **row})
        for each in planned.share_requirements
        for group in planned.groups
        for row in _rows_of_group(planned, each, runs, group)
    ]


def _rows_of_group(
    planned: PlannedStudy, requirement: ShareRequirement, runs: LaunchColumns, group: Sequence[int]
) -> Iterator[dict[str, Any]]:
    rows = LaunchRows.of(planned, runs, group, requirement.column)
    verdict = verdict_of(planned, requirement, runs, group)
    tails = tails_of(planned)
    each_tails = tails_of(planned, len(group)) if requirement.in_every_condition else tails
    in_each = []
    if planned.study.conditions:
        for design in group:
            of_design = LaunchRows.of(planned, runs, [design], requirement.column)
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
        for name, is_of in rows.parts(fact):
            part = rows.share(requirement, is_of)
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
