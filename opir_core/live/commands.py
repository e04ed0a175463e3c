"""What becomes of commands to sensors in a live run: the file of it, and warnings."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from opir_core.errors import SinkError
from opir_core.host.registry import warn
from opir_core.interfaces.records import OPERATOR, CommandRecord

if TYPE_CHECKING:
    from opir_core.output.run_files import CommandsFile

#: Sensors whose first refusal is a warning.
_MOST_SENSORS = 100


class RefusalWarnings:
    """Warns of the first command that each sensor refuses; an operator gets the answer itself."""

    def __init__(self) -> None:
        self._sensors = set[str]()

    def warn_of(self, commands: Iterable[CommandRecord]) -> None:
        """Warn of what became of commands."""
        for record in commands:
            is_first = record.sensor not in self._sensors and len(self._sensors) < _MOST_SENSORS
            if record.refusal and is_first and record.reason != OPERATOR:
                self._sensors.add(record.sensor)
                warn(f"director: a command to {record.sensor} is refused: {record.refusal}")


def file_after(
    file: "CommandsFile | None", commands: Sequence[CommandRecord]
) -> "CommandsFile | None":
    """Write what became of commands to a file; return it, None once it takes no more."""
    if file is not None and commands:
        try:
            file.write(commands)
        except SinkError as error:
            warn(f"{error}; further commands are not written")
            return None
    return file
