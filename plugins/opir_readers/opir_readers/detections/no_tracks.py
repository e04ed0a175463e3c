"""Why detections of another program began no track: which gate closed, with counts."""

from collections.abc import Iterator

import numpy as np

from opir_core import Plan
from opir_core.arrays import IntArray
from opir_core.errors import number_of
from opir_core.plugin import Detections
from opir_readers.detections.line_doubts import rare_lines

#: A share of a sensor's lines at one time with others, from which its times are rounded.
MANY = 0.5

#: Fewer scans than this begin no track.
FEWEST_SCANS = 4

#: The reason where times and scan periods allow tracks.
_NO_MOTION = (
    "lines of successive scans lead along no common motion within their standard deviations; are"
    " angles, sensors' places and standard deviations right?"
)


def reason_of_no_track(detections: Detections, plan: Plan) -> str:
    """Return why detections began no track, in a sentence.

    Times come first, then scan periods: a tracker starts tracks from lines in successive scans.
    """
    numbers = np.unique(detections.sensor).tolist()
    texts = [
        text
        for number in numbers
        for text in _reasons(detections.time_ns[detections.sensor == number], plan, number)
    ]
    lines = number_of("detection", len(detections.time_ns))
    texts = texts or list(rare_lines(detections, plan)) or [_NO_MOTION]
    return f"no track from {lines}: {'; '.join(texts)}"


def _reasons(time_ns: IntArray, plan: Plan, number: int) -> Iterator[str]:
    """Yield what is against a track in the times (n,) of one sensor, ns."""
    sensor = plan.sensors[number]
    times, counts = np.unique(time_ns, return_counts=True)
    together = int(counts[counts > 1].sum())
    if together > MANY * len(time_ns):
        whole = " whole" if not np.any(times % 1_000_000_000) else ""
        yield (
            f"{together} of {number_of('line', len(time_ns))} of {sensor.id} share {len(times)}{whole}"
            f"{' seconds' if whole else ' times'}, and several lines of a sensor at one time cannot"
            " start a track: give times with more decimals"
        )
    elif len(times) < FEWEST_SCANS:
        yield f"{sensor.id} has {number_of('detection', len(times))}, and a track takes {FEWEST_SCANS} scans"
