"""The windows of one run computed by several processes: the same windows, in order of time.

Each process is a copy of the parent (`fork`) with its plan and its engine, and computes every n-th
window. A window's result depends on earlier windows by the numbers of detections of the pairs, and
by their last detections where these are confirmed over scans: each process draws its looks, waits
for its turn, and passes both on at once (`_Relay`). Measuring, building and encoding follow at the
same time as those of other windows. Text comes in a buffer that worker and parent share and use
again for each window, columns in files in memory, which the parent maps: both are copied once.

A process that ends before its window is done is replaced, and its windows are computed again.
"""

import mmap
import os
import pickle
import signal
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle, send_handle
from typing import Any

import numpy as np
from attrs import define, field, frozen

from opir_core.errors import OpirError, Problem, SceneError
from opir_core.host.boundary import still_at_work
from opir_core.host.watchdog import STUCK, ended_if_stuck
from opir_core.interfaces.records import Window
from opir_core.simulation.engine import Engine

#: Windows that a process computes or has computed, and the parent has not taken.
_AHEAD = 2

#: Deaths of its process after which a window is given up.
_DEATHS = 3

#: Time between two looks at whose turn it is, s.
_POLL_S = 2e-4

#: Columns start at multiples of this, bytes.
_ALIGNMENT = 64

#: Room for the text of a window, bytes, of which only what is used takes memory; text beyond it
#: takes a file in memory.
BUFFER_BYTES = 256 << 20


@frozen
class Text:
    """The lines of some events; `withheld` events have no message."""

    lines: "bytes | memoryview"
    events: int = 0
    withheld: int = 0


#: Returns the lines of a window, in blocks.
Encode = Callable[[Window], Iterable[Text]]


@frozen
class Computed:
    """A window as observed, without tracks, and its encoded text."""

    window: Window
    texts: Mapping[str, Sequence[Text]]


class LostWindowError(OpirError):
    """A window whose processes died again and again."""

    exit_code = 4


class StuckWorkerError(OpirError):
    """A component that does not return in a worker process, which its watchdog has ended."""

    exit_code = STUCK


def require_workers(workers: int) -> None:
    """Raise `SceneError` if a run cannot have this number of worker processes."""
    if workers < 1:
        raise SceneError(
            [Problem("workers", f"{workers} is not a number of processes; give 1 or more")]
        )
    if workers > 1 and "fork" not in get_all_start_methods():
        words = "this system cannot copy a process (fork), which several workers need; use one"
        raise SceneError([Problem("workers", words)])


class WindowWorkers:
    """The worker processes of a run; a context that ends them.

    `edges_ns` are the ends of the windows; `encoders` are called in the workers with each window as
    observed, and then `reduced`, which returns what the parent needs of it.
    """

    def __init__(
        self,
        engine: Engine,
        edges_ns: Sequence[int],
        workers: int,
        encoders: Mapping[str, Encode],
        reduced: Callable[[Window], Window],
    ) -> None:
        require_workers(workers)
        self._tasks = list(zip([0, *edges_ns[:-1]], edges_ns, strict=True))
        self._encoders = encoders
        self._reduced = reduced
        self._engine = engine
        count = min(workers, len(self._tasks))
        self._relay = _Relay(engine, _AHEAD * count + 2)
        self._slots = [_Slot(_shared_memory(BUFFER_BYTES)) for _ in range(count)]
        #: The number of windows of each slot whose text the parent has written.
        self._written = np.frombuffer(_shared_memory(8 * count), dtype=np.int64)
        self._results: dict[int, Any] = {}
        self._deaths: dict[int, int] = {}

    def __enter__(self) -> "WindowWorkers":
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes, also those in the middle of a window."""
        for slot in self._slots:
            slot.end()

    def computed(self) -> Iterator[Computed]:
        """Yield the windows in order; re-raises a worker's error in place of its window.

        The text of a window is valid until the next one is asked for.
        """
        for slot in self._slots:
            self._start(slot)
        window_limit = _AHEAD * len(self._slots)
        for number in range(min(window_limit, len(self._tasks))):
            self._assign(number)
        for number in range(len(self._tasks)):
            while number not in self._results:
                self._receive()
            result = self._results.pop(number)
            if isinstance(result, BaseException):
                raise result
            if number + window_limit < len(self._tasks):
                self._assign(number + window_limit)
            yield result
            self._written[number % len(self._slots)] += 1

    def _assign(self, number: int) -> None:
        """Send a window to its worker; one that has ended gets it when it is replaced."""
        slot = self._slots[number % len(self._slots)]
        slot.waiting.append(number)
        with suppress(OSError):
            slot.link.send(number)

    def _receive(self) -> None:
        """Take the finished results, wait for one if necessary, and replace workers
        that have ended.
        """
        ready = wait(
            [handle for slot in self._slots for handle in (slot.link, slot.process.sentinel)]
        )
        for slot in self._slots:
            if slot.link in ready:
                self._take(slot)
            if slot.process.sentinel in ready:
                while slot.link.poll() and self._take(slot):
                    pass
                self._replace(slot)

    def _take(self, slot: "_Slot") -> bool:
        """Take one result of a worker; return whether there was a whole one."""
        try:
            number, message = slot.link.recv()
            result = (
                message if isinstance(message, BaseException) else self._unpacked(slot, message)
            )
        except (EOFError, OSError, RuntimeError, pickle.UnpicklingError):
            return False
        slot.waiting.remove(number)
        self._results[number] = result
        return True

    def _replace(self, slot: "_Slot") -> None:
        slot.end()
        if slot.process.exitcode == STUCK:  # it has said why
            raise StuckWorkerError(f"a worker process of the run ended with exit code {STUCK}")
        if slot.waiting:
            lost = slot.waiting[0]
            self._deaths[lost] = self._deaths.get(lost, 0) + 1
            if self._deaths[lost] >= _DEATHS:
                start_ns, end_ns = self._tasks[lost]
                words = (
                    f"the worker process of the window from {start_ns * 1e-9:g} to"
                    f" {end_ns * 1e-9:g} s ended"
                )
                raise LostWindowError(
                    f"{words} {_DEATHS} times, possibly out of memory; run with fewer workers"
                )
        self._start(slot)
        for number in slot.waiting:
            with suppress(OSError):
                slot.link.send(number)

    def _start(self, slot: "_Slot") -> None:
        """Start the process of a slot."""
        context = get_context("fork")
        slot.link, worker_end = context.Pipe()
        parents = [open_slot.link for open_slot in self._slots if open_slot.link is not None]
        slot.process = context.Process(
            target=self._work, args=(worker_end, parents, slot.buffer), daemon=True
        )
        with warnings.catch_warnings():
            # Python warns of copies of processes with threads: those of the parent hash files and
            # hold no lock that a worker takes.
            warnings.filterwarnings("ignore", message=".*fork.*", category=DeprecationWarning)
            slot.process.start()
        worker_end.close()

    def _work(self, link: Connection, parents: Sequence[Connection], buffer: mmap.mmap) -> None:
        """Compute windows until the parent ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        for parent in parents:
            parent.close()
        with suppress(EOFError, OSError), ended_if_stuck():
            while True:
                number = link.recv()
                self._compute(number, link, buffer)

    def _compute(self, number: int, link: Connection, buffer: mmap.mmap) -> None:
        """Compute a window and send it: a message, and the file in memory to which it refers."""
        packing = _Packing(buffer)
        try:
            window = self._engine.observe(
                *self._tasks[number], self._relay.turn(number, self._engine)
            )
            round_, slot = divmod(number, len(self._slots))
            if self._encoders:
                self._relay.wait_until(lambda: self._written[slot] >= round_)
            texts = {
                name: [
                    (packing.text(text.lines), text.events, text.withheld)
                    for text in encode(window)
                ]
                for name, encode in self._encoders.items()
            }
            columns: list[slice] = []
            head = pickle.dumps(
                self._reduced(window),
                protocol=5,
                buffer_callback=lambda column: columns.append(packing.column(column.raw())),
            )
            link.send((number, (head, columns, texts, packing.size)))
            if packing.size:
                send_handle(link, packing.file, os.getppid())
        except OSError:
            raise
        except Exception as error:
            link.send((number, _sendable(error)))
        finally:
            packing.close()

    def _unpacked(self, slot: "_Slot", message: Any) -> Computed:
        """Return the window and the texts of a message, as views of its file and of the slot's
        buffer.
        """
        head, columns, texts, size = message
        file = memoryview(b"")
        if size:
            handle = recv_handle(slot.link)
            try:
                file = memoryview(mmap.mmap(handle, size, prot=mmap.PROT_READ))
            finally:
                os.close(handle)
        window = pickle.loads(head, buffers=[file[rows] for rows in columns])
        buffer = memoryview(slot.buffer)
        return Computed(
            window,
            {
                name: [
                    Text((file if in_file else buffer)[rows], events, withheld)
                    for (in_file, rows), events, withheld in packed
                ]
                for name, packed in texts.items()
            },
        )


@define
class _Slot:
    """A worker process, the parent's end of its pipe, and the windows it has been given."""

    buffer: mmap.mmap
    process: Any = None
    link: Any = None
    waiting: list[int] = field(factory=list)

    def end(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.terminate()
            self.process.join()
            self.link.close()


class _Relay:
    """The state that windows pass on to the next one, in memory that all processes share.

    Before window k its state is in slot k of a ring, and `published` is at least k. A process reads
    that slot and writes the next one: if it dies meanwhile, its successor does the same again.
    """

    def __init__(self, engine: Engine, slots: int) -> None:
        self._parent = os.getpid()
        self._state = engine.carried
        sizes = [-(-array.nbytes // _ALIGNMENT) * _ALIGNMENT for array in self._state]
        memory = _shared_memory(_ALIGNMENT + slots * sum(sizes))
        self._published = np.frombuffer(memory, dtype=np.int64, count=1)
        self._slots = []
        at = _ALIGNMENT
        for _ in range(slots):
            arrays = []
            for array, size in zip(self._state, sizes, strict=True):
                buffer = np.frombuffer(memory, dtype=array.dtype, count=array.size, offset=at)
                arrays.append(buffer.reshape(array.shape))
                at += size
            self._slots.append(arrays)
        self._copy(self._state, self._slots[0])

    @contextmanager
    def turn(self, number: int, engine: Engine) -> Iterator[None]:
        """Wait until the states of all windows before a window are known, and publish that after
        it.
        """
        self.wait_until(lambda: self._published[0] >= number)
        self._copy(self._slots[number % len(self._slots)], engine.carried)
        yield
        self._copy(engine.carried, self._slots[(number + 1) % len(self._slots)])
        self._published[0] = max(int(self._published[0]), number + 1)

    def wait_until(self, is_done: Callable[[], Any]) -> None:
        """Wait, in a worker, for what other processes do; end with the parent."""
        while not is_done():
            if os.getppid() != self._parent:
                os._exit(1)
            still_at_work()
            time.sleep(_POLL_S)

    @staticmethod
    def _copy(source: Sequence[Any], into: Sequence[Any]) -> None:
        for array, buffer in zip(source, into, strict=True):
            buffer[...] = array


class _Packing:
    """Puts the text of a window into a buffer and, what has no room there, with its columns into a
    file in memory.
    """

    def __init__(self, buffer: mmap.mmap) -> None:
        self._buffer = buffer
        self._used = 0
        self.file = -1
        self.size = 0

    def text(self, lines: "bytes | memoryview") -> tuple[bool, slice]:
        """Return whether lines were put into the file, and where."""
        start = self._used
        if start + len(lines) > len(self._buffer):
            return True, self.column(lines)
        self._used += len(lines)
        self._buffer[start : self._used] = lines
        return False, slice(start, self._used)

    def column(self, content: Any) -> slice:
        """Return where content was put in the file."""
        view = memoryview(content).cast("B")
        if not len(view):
            return slice(0, 0)
        if self.file < 0:
            self.file = _memory_file()
        start = -(-self.size // _ALIGNMENT) * _ALIGNMENT
        self.size = start + len(view)
        while len(view):
            view = view[os.pwrite(self.file, view, self.size - len(view)) :]
        return slice(start, self.size)

    def close(self) -> None:
        """Close this process's end of the file."""
        if self.file >= 0:
            os.close(self.file)


def _shared_memory(size: int) -> mmap.mmap:
    """Return memory that processes started from now on share; it is taken when it is used."""
    return mmap.mmap(-1, size)


def _memory_file() -> int:
    """Return a new file that has no name, in memory where the system can."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("opir window")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


def _sendable(error: Exception) -> Exception:
    """Return an error that another process can read: itself, or one with its words."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
