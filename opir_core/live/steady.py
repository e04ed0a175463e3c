"""A process that keeps a live run's pace: what the interpreter does of its own accord holds up no cycle for long."""

import gc
import sys

#: How long a thread keeps the interpreter from the run's, s. By default it is 5 ms, each time.
SWITCH_S = 0.001


def steady_process() -> None:
    """Prepare this process for a live run, once the run is made and before it starts.

    What is alive by now lives as long as the run: it is taken out of the garbage collector's sight, which would
    otherwise go through all of it every quarter of a minute, some 20 ms each time.
    """
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_S)
