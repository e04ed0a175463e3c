"""The output of a run in several processes: workers encode what the parent writes, in order.

Lines of events and of the truth are encoded in the workers, by the sinks and the file that the
parent has opened; all other sinks write the window's columns in the parent.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from opir_core.interfaces.outputs import Delivery, Sink
from opir_core.interfaces.records import Window
from opir_core.output.run_files import TruthFile
from opir_core.planning.plan import Plan
from opir_core.simulation.run import window_edges_ns
from opir_core.simulation.shared_run import shared_windows
from opir_core.simulation.workers import Encode, Text, require_workers

_TRUTH = "truth"


@runtime_checkable
class LineSink(Protocol):
    """A sink of lines that may be encoded in another process: each block with its events, and those
    withheld.
    """

    def encoded(self, window: Window) -> Iterable[tuple[bytes, int, int]]:
        """Yield the lines of a window in blocks; called in a copy of the process."""

    def write_encoded(self, window: Window, blocks: Iterable[tuple[Any, int, int]]) -> None:
        """Write the blocks of a window."""


class SharedOutput:
    """The windows of a run in several processes, and the texts of the present one."""

    def __init__(self, plan: Plan, workers: int, *, needs_columns: bool) -> None:
        require_workers(workers)
        self._plan = plan
        self._workers = workers
        #: Whether anything but the summary uses the windows' columns in the parent.
        self._needs_columns = needs_columns
        self._encoders: dict[str, Encode] = {}
        self._texts: Mapping[str, Sequence[Text]] = {}

    def windows(self) -> Iterator[Window]:
        """Yield the windows; the workers start with the first, when everything is open."""
        shared = shared_windows(
            self._plan,
            window_edges_ns(self._plan, workers=self._workers),
            self._workers,
            self._encoders,
            only_counted=not self._needs_columns,
        )
        for window, texts in shared:
            self._texts = texts
            yield window

    def texts(self, name: str) -> Sequence[Text] | None:
        """Return the texts of the current window that the workers encoded for an output, or
        None.
        """
        return self._texts.get(name)

    def sink(self, path: str, sink: Sink) -> Sink:
        """Return a sink that writes what the workers encode, or the sink itself if it takes
        columns.
        """
        if not isinstance(sink, LineSink):
            self._needs_columns = True
            return sink
        self._encoders[path] = lambda window: (Text(*block) for block in sink.encoded(window))
        return SharedLines(self, path, sink)

    def truth(self, file: Any) -> Any:
        """Return a truth file that writes what the workers encode, or the file itself if it takes
        columns.
        """
        if not isinstance(file, TruthFile):
            self._needs_columns = True
            return file
        self._encoders[_TRUTH] = lambda window: map(Text, file.encoded(window))
        return SharedTruth(self, file)


class SharedLines(Sink):
    """A file of lines, some of which other processes have encoded."""

    def __init__(self, shared: SharedOutput, path: str, sink: Any) -> None:
        self._shared = shared
        self._path = path
        self._sink = sink

    def write(self, window: Window) -> None:
        """Write a window's events."""
        texts = self._shared.texts(self._path)
        if texts is None:
            self._sink.write(window)
        else:
            self._sink.write_encoded(
                window, ((text.lines, text.events, text.withheld) for text in texts)
            )

    def close(self) -> Delivery:
        """Close the file."""
        return self._sink.close()


class SharedTruth:
    """A truth file, some lines of which other processes have encoded."""

    def __init__(self, shared: SharedOutput, file: TruthFile) -> None:
        self._shared = shared
        self._file = file

    def write(self, window: Window) -> None:
        """Write the truth of a window's detections."""
        texts: Iterable[Text] | None = self._shared.texts(_TRUTH)
        if texts is None:
            self._file.write(window)
            return
        for text in texts:
            self._file.write_bytes(text.lines)
