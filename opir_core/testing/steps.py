"""Work as a count: how many steps of Python a function takes, the same on every machine.

Array code takes a number of steps that hardly depends on the rows; a loop over rows takes several for each.
"""

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

#: A loop over rows that computes anything takes more steps than this for each; array work in blocks of rows, fewer.
LOOP_STEPS = 8.0


def python_steps(act: Callable[[], object]) -> int:
    """Return how many bytecode instructions a function runs, those of all it calls included.

    The function is run once beforehand, so that imports and caches do not count.
    """
    act()
    count = 0

    def note(frame: FrameType, event: str, _argument: Any) -> Any:
        nonlocal count
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        return note

    earlier = sys.gettrace()
    sys.settrace(note)
    try:
        act()
    finally:
        sys.settrace(earlier)
    return count


def steps_per_row(act: Callable[[int], object], few: int, many: int) -> float:
    """Return how many more steps a function takes for each row more, between `few` and `many` rows."""
    return (python_steps(lambda: act(many)) - python_steps(lambda: act(few))) / (many - few)
