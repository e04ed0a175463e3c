"""The finished runs of a study: kept on the disk, read column by column.

In memory are a byte a run, and the place of each part.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
from attrs import define, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_studies.parts import LAUNCHES, PARTS, Parts, remove_unfinished
from opir_studies.planning import PlannedDesign, PlannedStudy
from opir_studies.runs import RunRecord, run_key


@frozen
class _Part:
    """A part with the first and the last number of its runs."""

    path: Path
    first: int
    last: int


@define(eq=False)
class _RunsOfIdentity:
    """The runs of designs of one identity: which are there (runs,), and their parts."""

    is_there: BoolArray
    parts: list[_Part] = field(factory=list)


@define(eq=False)
class FinishedRuns:
    """The finished runs of a study's designs.

    Designs of one identity share their runs.
    """

    parts: Parts
    designs: tuple[PlannedDesign, ...]
    _of: dict[str, _RunsOfIdentity]

    @classmethod
    def of(cls, planned: PlannedStudy, folder: Path) -> "FinishedRuns":
        """Return the runs in a study's folder; raises `SceneError` for a damaged part.

        Runs of other definitions of the study, or without a column, are left alone.
        """
        remove_unfinished(folder)
        parts = Parts(folder / PARTS, tuple(planned.units), planned.launch_units)
        runs = planned.study.runs
        of = {
            design.identity: _RunsOfIdentity(np.zeros(runs, np.bool_)) for design in planned.designs
        }
        finished = cls(parts, planned.designs, of)
        for path, keys, numbers in parts.found():
            finished._find(path, keys, numbers)
        return finished

    def _find(self, path: Path, keys: Sequence[str], numbers: IntArray) -> None:
        """Enter the runs of a part that is on the disk, if they are of a design."""
        first = int(numbers[0])
        owner = next((each for each in self._of if run_key(each, first) == keys[0]), None)
        if owner is not None:
            self._enter(owner, path, numbers)

    def _enter(self, identity: str, path: Path, numbers: IntArray) -> None:
        runs = self._of[identity]
        wanted = numbers[numbers < len(runs.is_there)]
        runs.is_there[wanted] = True
        runs.parts.append(_Part(path, int(numbers.min()), int(numbers.max())))

    def add(self, design: int, records: Iterable[RunRecord]) -> None:
        """Write the records of runs of a design as a part."""
        rows = list(records)
        if rows:
            identity = self.designs[design].identity
            path = self.parts.write({run_key(identity, row.replicate): row for row in rows})
            self._enter(identity, path, np.array([row.replicate for row in rows], dtype=np.int64))

    def count(self, numbers: range) -> int:
        """Return how many runs of these numbers there are, of all designs."""
        shard = slice(numbers.start, numbers.stop, numbers.step)
        return sum(int(np.count_nonzero(runs.is_there[shard])) for runs in self._of.values())

    def missing(self, design: int, numbers: range) -> IntArray:
        """Return those of some numbers of a design's runs that are not there."""
        every = np.arange(numbers.start, numbers.stop, numbers.step)
        return every[~self._of[self.designs[design].identity].is_there[every]]

    def first(self, counts: Sequence[int]) -> "StudyRuns":
        """Return the first runs of each design, by their numbers of runs."""
        return StudyRuns(self, tuple(counts))

    def rows(
        self, design: int, columns: Collection[str], numbers: range
    ) -> Iterator[tuple[IntArray, pa.Table]]:
        """Yield the number (n,) of each run, and the rows of some columns, of each part that has
        runs of these numbers; a run may come twice.
        """
        for part in self._of[self.designs[design].identity].parts:
            if part.first < numbers.stop and part.last >= numbers.start:
                table = self.parts.table(part.path, ["replicate", *columns])
                number = table["replicate"].to_numpy()
                is_wanted = (number >= numbers.start) & (number < numbers.stop)
                yield number[is_wanted], table.select(list(columns)).filter(pa.array(is_wanted))

    def is_there(self, design: int, count: int) -> BoolArray:
        """Return which of the first runs of a design there are (count,)."""
        return self._of[self.designs[design].identity].is_there[:count]


@frozen
class StudyRuns:
    """The finished ones of the first runs of each design, in the order of their numbers."""

    finished: FinishedRuns
    counts: tuple[int, ...]

    def numbers(self, design: int) -> IntArray:
        """Return the numbers of the runs of a design (n,)."""
        return np.flatnonzero(self.finished.is_there(design, self.counts[design]))

    def values(self, design: int, column: str) -> FloatArray:
        """Return a column of a design's runs (n,)."""
        return self._filled(design, column, ())

    def launch_values(self, design: int, column: str) -> FloatArray:
        """Return a column of the launches of a design's runs (n, launches)."""
        launches = len(self.finished.designs[design].launches)
        return self._filled(design, f"{LAUNCHES}{column}", (launches,))

    def tables(self, design: int, columns: Mapping[str, str], size: int) -> Iterator[pa.Table]:
        """Yield the rows of some columns of a design's runs, at most `size` at a time; `columns`
        has their names by those in parts.
        """
        count = self.counts[design]
        for start in range(0, count, size):
            parts = self.finished.rows(design, columns, range(start, min(start + size, count)))
            pairs = list(parts)
            if pairs:
                number = np.concatenate([number for number, _ in pairs])
                _, order = np.unique(number, return_index=True)
                rows = pa.concat_tables([table for _, table in pairs]).take(pa.array(order))
                yield rows.rename_columns(list(columns.values()))

    def _filled(self, design: int, column: str, shape: tuple[int, ...]) -> FloatArray:
        is_there = self.finished.is_there(design, self.counts[design])
        values = np.empty((np.count_nonzero(is_there), *shape))
        place = np.cumsum(is_there, dtype=np.int32) - 1
        for number, table in self.finished.rows(design, [column], range(len(is_there))):
            rows = table[column].combine_chunks()
            plain = rows.flatten() if shape else rows
            values[place[number]] = plain.to_numpy(zero_copy_only=False).reshape(
                len(number), *shape
            )
        return values
