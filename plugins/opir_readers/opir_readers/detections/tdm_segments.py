"""A segment of a Tracking Data Message, in whichever form it was written."""

from attrs import Factory, define

from opir_core.plugin import BadFileError

#: The keywords of the two angles of a direction.
ANGLES = ("ANGLE_1", "ANGLE_2")


@define
class TdmSegment:
    """The metadata of a segment, and its angles by time: (first, second), with their lines."""

    line: int
    meta: dict[str, str] = Factory(dict)
    angles: dict[str, dict[str, tuple[str, int]]] = Factory(dict)

    @property
    def sensor(self) -> str:
        """Return the participant that received: the last one of PATH, 1 without it."""
        number = self.meta.get("PATH", "1").split(",")[-1].strip()
        name = self.meta.get(f"PARTICIPANT_{number}", "")
        if not name:
            raise BadFileError(
                f"line {self.line}: the metadata lack PARTICIPANT_{number}, the sensor"
            )
        return name

    def target(self) -> str | None:
        """Return the first participant that is not the sensor."""
        names = (value for key, value in self.meta.items() if key.startswith("PARTICIPANT_"))
        return next((name for name in names if name != self.sensor), None)

    def keyword(self, key: str, default: str) -> str:
        """Return the value of a keyword in capitals."""
        return self.meta.get(key, default).upper()

    def take_angle(self, key: str, time: str, value: str, number: int) -> None:
        """Add an angle of a time, in line `number`; raises `BadFileError` for one that stands
        twice.
        """
        pair = self.angles.setdefault(time, {})
        if key in pair:
            raise BadFileError(
                f"line {number}: {key} stands twice for {time}, in line {pair[key][1]} too"
            )
        pair[key] = value, number
