"""The settings of a fleet in a scene: a file of elements or a pattern, and which of its satellites.

Nothing heavy is imported.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from attrs import frozen

from opir_core.plugin import FileReader, nested, number, text
from opir_readers.orbits.patterns import SlotFleetConfig, WalkerFleetConfig, require_single

Ranges = tuple[tuple[int, int], ...]


def ranges_of(numbers: str) -> Ranges:
    """Return the ranges of `25544,40000:40100`; raises `ValueError`.

    >>> ranges_of("5,7:9")
    ((5, 5), (7, 9))
    """
    pairs = [text.partition(":") for text in numbers.split(",")]
    return tuple((int(low), int(high or low)) for low, _, high in pairs)


def _numbers_complaint(numbers: str | None) -> str | None:
    try:
        ranges_of(numbers or "0")
    except ValueError:
        return f"{numbers!r} are no catalogue numbers, like 25544,40000:40100"
    return None


@frozen
class FleetConfig:
    """The settings of `fleet` in a sensor's block: one of `file`, `walker` and `slots`, and
    filters.
    """

    file: str | None = text(
        default=None,
        help="a file of OMM (JSON, CSV, KVN or XML) or two-line elements; relative to the working"
        " directory",
    )
    walker: WalkerFleetConfig | None = nested(
        default=None, help="a Walker pattern of circular orbits"
    )
    slots: SlotFleetConfig | None = nested(default=None, help="a ring of geostationary slots")
    name: str | None = text(default=None, help="only satellites with names like this, with * and ?")
    min_inclination_deg: float = number(
        default=0.0, unit="deg", minimum=0.0, maximum=180.0, help="least inclination"
    )
    max_inclination_deg: float = number(
        default=180.0, unit="deg", minimum=0.0, maximum=180.0, help="largest inclination"
    )
    numbers: str | None = nested(
        default=None,
        check=_numbers_complaint,
        help="only these catalogue numbers, of a pattern those from 1 on: 25544,40000:40100",
    )
    max_age_days: float | None = number(
        default=None,
        unit="d",
        minimum=0.0,
        maximum=1e5,
        help="only elements within this time of the scene's epoch",
    )

    def __attrs_post_init__(self) -> None:
        require_single(self, ("file", "walker", "slots"), "give file, walker or slots")

    def satellites(
        self, epoch_us: int | None, readers: Sequence[FileReader]
    ) -> Sequence[Mapping[str, Any]]:
        """Return `id` and `orbit` of the satellites, for a scene epoch (None if unknown); raises
        `BadFileError`.
        """
        from opir_readers.orbits.fleet import FleetFilter, satellites_of_file, satellites_of_pattern

        pattern = self.walker or self.slots
        fleet_filter = FleetFilter(
            name=self.name,
            inclination_deg=(self.min_inclination_deg, self.max_inclination_deg),
            numbers=ranges_of(self.numbers) if self.numbers else (),
            most_age_days=None if epoch_us is None or pattern else self.max_age_days,
            epoch_s=(epoch_us or 0) * 1e-6,
        )
        if pattern is not None:
            return satellites_of_pattern(pattern.rows(), fleet_filter)
        return satellites_of_file(self.file or "", fleet_filter, epoch_us or 0, readers)
