"""Power cuts: what a process does to a folder is recorded, and the folder is made as a cut would
have left it.

    recording = record(folder, program, tmp_path)
    for cut in power_cuts(recording, range(1000)):
        cut.make(place)
        ...

A process runs with `recorded_disk.c` loaded before libc, so SQLite's calls and Arrow's are recorded
like Python's. What the recorder misses (mappings, stdio) would be noticed: all calls together must
make the folder that the process left.

The disk is one that orders nothing by itself. After a call, any call, the power fails:

* the data of a file, its length included, last after an fsync of the file. Of what was written or
  truncated later each call is kept or lost for itself, and a write may be torn: some of its sectors
  of 512 bytes are kept. A sector that was lost beyond the old end is zeros;
* a name, whether made, renamed or removed, lasts after an fsync of its folder, of both folders for
  a rename between two. Of later changes each is kept or lost for itself. A rename is kept or lost
  as a whole;
* what is in a folder whose own name is lost is lost.
"""

import os
import random
import shutil
import struct
import subprocess
import sys
from pathlib import Path

from attrs import Factory, define, evolve, field, frozen

OPEN, WRITE, SYNC, TRUNCATE, RENAME, UNLINK, MKDIR, RMDIR = range(1, 9)
#: A file whose writes are notes of the process, which are never lost.
NOTES = "notes"
SECTOR = 512
_HEADER = struct.Struct("<IIIIQQqQ")
_SHIM = Path(__file__).with_name("recorded_disk.c")


def can_record():
    """Return whether this machine can record: Linux with a C compiler."""
    return sys.platform == "linux" and shutil.which("cc") is not None


@frozen
class Call:
    """A call that changed the disk; `offset` of an `OPEN` is below 0 if it can neither make nor
    truncate the file.
    """

    kind: int
    path: str
    target: str
    time_s: float
    inode: int
    offset: int
    content: bytes


@frozen(eq=False)
class Recording:
    """The calls of a process that concern a folder, and what was in it before, by path; None is a
    folder.
    """

    folder: Path
    before: dict[str, bytes | None]
    calls: tuple[Call, ...]
    output: str


@frozen
class PowerCut:
    """What a power cut leaves: files and folders by path, when it was at the latest, and the notes
    made before it.
    """

    seed: int
    calls: int
    time_s: float
    tree: dict[str, bytes | None]
    notes: tuple[tuple[float, bytes], ...]

    def make(self, folder):
        """Make a folder with these files and no others, and return it."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for path, content in self.tree.items():
            if content is None:
                (folder / path).mkdir(exist_ok=True)
            else:
                (folder / path).write_bytes(content)
        return folder


def record(folder, program, scratch, *inputs):
    """Run a program of Python, with arguments, and return what it did to a folder."""
    shim = scratch / "recorded_disk.so"
    log = scratch / "calls"
    folder = folder.resolve()
    if not shim.exists():
        subprocess.run(
            ["cc", "-shared", "-fPIC", "-O1", "-o", shim, _SHIM, "-ldl", "-lpthread"], check=True
        )
    log.unlink(missing_ok=True)
    initial = tree_of(folder)
    environment = {
        **os.environ,
        "LD_PRELOAD": str(shim),
        "OPIR_DISK": str(folder),
        "OPIR_DISK_LOG": str(log),
    }
    environment["PYTHONPATH"] = os.pathsep.join(
        [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    )
    command = [sys.executable, "-c", program, *map(str, inputs)]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    recording = Recording(folder, initial, tuple(_calls(log.read_bytes())), ended.stdout)
    disk = _Disk(recording)
    for call in recording.calls:
        disk.do(call)
    assert disk.tree() == tree_of(folder), "the recorder has missed a call"
    return recording


def tree_of(folder):
    """Return the files of a folder and of those in it, by path; None is a folder. Notes are left
    out.
    """
    result = sorted(path for path in folder.rglob("*") if path.name != NOTES)
    return {
        str(path.relative_to(folder)): None if path.is_dir() else path.read_bytes()
        for path in result
    }


def note(folder, text):
    """Make a note in a recorded process, with the time."""
    with (folder / NOTES).open("ab", buffering=0) as file:
        file.write(f"{text}\n".encode())


def power_cuts(recording, seeds):
    """Yield a power cut for each seed, in the order of their times."""
    calls = recording.calls
    drawn = [(random.Random(seed).randrange(len(calls) + 1), seed) for seed in seeds]
    disk = _Disk(recording)
    done = 0
    for count, seed in sorted(drawn):
        for call in calls[done:count]:
            disk.do(call)
        done = count
        at_s = calls[min(count, len(calls) - 1)].time_s
        yield PowerCut(
            seed, count, at_s, disk.after_cut(random.Random(f"cut {seed}")), tuple(disk.notes)
        )


def kills(recording):
    """Yield what SIGKILL leaves at each call, before it and in the middle of a write: all that was
    written till then.

    The kernel keeps what a process has written, whether it was synced or not.
    """
    disk = _Disk(recording)
    for count, call in enumerate(recording.calls):
        if call.kind == SYNC:
            continue
        yield PowerCut(count, count, call.time_s, disk.tree(), tuple(disk.notes))
        if call.kind == WRITE and disk.is_of_a_file(call):
            disk.do(evolve(call, content=call.content[: len(call.content) // 2]))
            yield PowerCut(count, count, call.time_s, disk.tree(), tuple(disk.notes))
        disk.do(call)


def _calls(log):
    at = 0
    while at < len(log):
        kind, argument, second, _padding, time_ns, inode, offset, size = _HEADER.unpack_from(
            log, at
        )
        start = at + _HEADER.size
        size = size if kind == WRITE else 0
        ends = start + argument, start + argument + second, start + argument + second + size
        path = log[start : ends[0]].decode()
        target = log[ends[0] : ends[1]].decode()
        yield Call(kind, path, target, time_ns / 1e9, inode, offset, log[ends[1] : ends[2]])
        at = ends[2]


@define(eq=False)
class _Node:
    """A file or a folder: content on the disk, and writes (offset, bytes) and truncations (length,
    None) since.
    """

    is_folder: bool
    content: bytearray = Factory(bytearray)
    pending: list[tuple[int, bytes | None]] = Factory(list)

    def after(self, keeps):
        made = bytearray(self.content)
        for offset, content in self.pending:
            for start, content_piece in keeps.parts(offset, content):
                _put(made, start, content_piece)
        return bytes(made)

    def sync(self):
        for file in self.pending:
            _put(self.content, *file)
        self.pending.clear()


def _put(made, offset, content):
    end = offset + len(content or b"")
    if len(made) < end:
        made.extend(bytes(end - len(made)))
    if content is None:
        del made[offset:]
    else:
        made[offset:end] = content


@frozen
class _Keeps:
    """What a cut keeps of what was not synced."""

    rng: random.Random | None
    share: float = 1.0

    def __call__(self):
        return self.rng is None or self.rng.random() < self.share

    def parts(self, offset, content):
        """Yield what is kept of a write, or of a truncation."""
        if content is None or self.rng is None or self.rng.random() < 0.5:
            if self():
                yield offset, content
            return
        end = offset + len(content)
        for start in range(offset - offset % SECTOR, end, SECTOR):
            if self():
                first = max(start, offset)
                last = min(start + SECTOR, end)
                yield first, content[first - offset : last - offset]


@define(eq=False)
class _Change:
    """Names that change together, by folder and name, and the folders that have not been synced
    since.
    """

    names: dict[tuple[_Node, str], _Node | None]
    waits: set[_Node] = field(init=False)

    def __attrs_post_init__(self):
        self.waits = {folder for folder, _name in self.names}


class _Disk:
    """A disk in a recording, after some of its calls."""

    def __init__(self, recording):
        self.notes = []
        self._root = _Node(is_folder=True)
        self._top = str(recording.folder)
        self._names = {}
        self._lasting = {}
        self._changes = []
        self._by_inode = {}
        self._notes = _Node(is_folder=False)
        for path, content in recording.before.items():
            node = _Node(content is None, bytearray(content or b""))
            self._names[self._place(f"{self._top}/{path}")] = node
        self._lasting = dict(self._names)

    def do(self, call):
        """Do a call."""
        if call.kind in (OPEN, MKDIR):
            self._open(call)
        elif call.kind in (RENAME, UNLINK, RMDIR):
            changed = {self._place(call.path): None}
            if call.kind == RENAME:
                changed[self._place(call.target)] = self._names[self._place(call.path)]
            self._change(changed)
        elif (node := self._by_inode[call.inode]) is self._notes:
            self.notes.append((call.time_s, call.content))
        elif call.kind == SYNC:
            self._sync(node)
        else:
            node.pending.append((call.offset, call.content if call.kind == WRITE else None))

    def is_of_a_file(self, call):
        """Return whether a call is of a file of the disk, not of the notes."""
        return self._by_inode[call.inode] is not self._notes

    def after_cut(self, rng):
        """Return what a power cut now leaves."""
        return self.tree(_Keeps(rng, rng.choice((0.0, 0.5, 0.9, 1.0, rng.random()))))

    def tree(self, keeps=None):
        """Return files and folders by path, with what is kept of what was not synced; by default
        all of it.
        """
        keeps = keeps or _Keeps(None)
        names = dict(self._lasting)
        for change in self._changes:
            if not change.waits or keeps():
                names.update(change.names)
        children = {}
        for (folder, name), node in names.items():
            if node is not None:
                children.setdefault(folder, []).append((name, node))
        return dict(sorted(_walk(self._root, "", children, keeps)))

    def _place(self, path):
        """Return the folder and the name of a path."""
        *folders, name = Path(path).relative_to(self._top).parts
        folder = self._root
        for each in folders:
            result = self._names[folder, each]
            assert result is not None
            folder = result
        return folder, name

    def _open(self, call):
        if call.path == self._top:
            self._by_inode[call.inode] = self._root
            return
        place = self._place(call.path)
        if place == (self._root, NOTES):
            self._by_inode[call.inode] = self._notes
            return
        node = self._names.get(place)
        if node is None:
            node = _Node(is_folder=call.kind == MKDIR)
            self._change({place: node})
        elif call.kind == OPEN and call.offset > 0:
            node.pending.append((0, None))
        self._by_inode[call.inode] = node

    def _change(self, names):
        self._names.update(names)
        self._changes.append(_Change(names))

    def _sync(self, node):
        if not node.is_folder:
            node.sync()
            return
        for change in self._changes:
            change.waits.discard(node)
        while self._changes and not self._changes[0].waits:
            self._lasting.update(self._changes.pop(0).names)


def _walk(folder, above, children, keeps):
    for name, node in children.get(folder, ()):
        yield above + name, None if node.is_folder else node.after(keeps)
        if node.is_folder:
            yield from _walk(node, f"{above}{name}/", children, keeps)
