"""What readers of files return, and what they are given."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from attrs import Factory, frozen

if TYPE_CHECKING:  # the descriptions of readers import no numpy
    from opir_core.arrays import FloatArray, IntArray

#: What a reader may yield: states of a flight, orbits of satellites by the keywords of an OMM,
#: detections of others.
FILE_CONTENTS = ("trajectories", "orbits", "detections")


class BadFileError(ValueError):
    """A file that a reader cannot take; the only argument is the reason, with its line and the
    remedy.
    """


@frozen(kw_only=True)
class ReaderContext:
    """The context of a reader: the text of a file, its lines ended by line feeds, and the scene
    that names it.

    `epoch_us` is the scene's zero of time, microseconds of UTC since 1970-01-01.
    """

    text: str
    epoch_us: int = 0


@frozen(eq=False)
class StateTable:
    """States in order of time: scene times (n,), s, ECEF positions (n, 3), m, and velocities over
    the Earth, m/s.

    `velocity_m_s` is None where the file has none. `run` (n,) numbers the runs of smooth motion,
    which polynomials do not cross. `burns_s` (k, 2) are the scene times of ignition and burnout of
    each burn, in order. `line_of` returns the line of a row, from 1; `notes` are what a user should
    know of the reading; `column_names` are those of a table of text by what they hold, `has_dates` says
    that the times are dates, which no setting shifts, and `frame` is that of the file in words.
    """

    time_s: "FloatArray"
    position_m: "FloatArray"
    velocity_m_s: "FloatArray | None"
    run: "IntArray"
    burns_s: "FloatArray"
    line_of: Callable[[int], int] = int
    notes: tuple[str, ...] = ()
    column_names: Mapping[str, str] = Factory(dict)
    has_dates: bool = False
    frame: str = "ECEF"
