"""`opir doctor`: what this machine and this installation would do to a run, on one page.

Each finding is `ok`, `warn` (a run works, but mind this) or `fail` (a run will fail). With a scene,
its outputs, their folders and spools are examined too. Nothing is changed.
"""

import argparse
import errno
import json
import os
import platform
import resource
import shutil
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from attrs import asdict, frozen

from opir_core import Host, __version__, load_scene
from opir_core.cli import table
from opir_core.errors import OpirError, reason_of
from opir_core.host import PACKAGES, Search, contested
from opir_core.output import WITHOUT_SPOOL
from opir_core.scene import Choice

OK = "ok"
WARN = "warn"
FAIL = "fail"

#: Libraries whose versions decide about results or speed.
_LIBRARIES = ("numpy", "scipy", "msgspec", "attrs", "cattrs", "pluggy", "pyyaml")

_GIB = 1 << 30
#: Below this much free disk or memory a long run is at risk, bytes: events of some millions of
#: detections take 1 GiB.
_LEAST_FREE = _GIB
#: Files and sockets that a service with a few hundred viewers holds open.
_FILES = 1024
#: Earliest plausible time of day, s since 1970: that of this release. A machine without a clock
#: starts in 1970.
_RELEASED_S = 1_790_000_000.0

#: Exit code when something would fail: that of a missing or broken component, or of an output.
_FAILED = 5


@frozen
class Finding:
    """One finding: the area, its state, and what was found, with the way out."""

    area: str
    state: str
    text: str


def doctor(arguments: argparse.Namespace) -> int:
    """Print the findings; exit code 5 if a run would fail."""
    found = [*versions(), *plugins(), *limits(), *clock(), *ports(arguments.port), *folder(Path())]
    if arguments.scene is not None:
        found += outputs(arguments.scene)
    text = (
        json.dumps([asdict(each) for each in found], indent=2) if arguments.json else _text(found)
    )
    sys.stdout.write(text + "\n")
    return _FAILED if any(each.state == FAIL for each in found) else 0


def _text(found: Sequence[Finding]) -> str:
    rows = [(each.state, each.area, each.text) for each in found]
    count = {state: sum(each.state == state for each in found) for state in (OK, WARN, FAIL)}
    return f"{table(('state', 'area', 'finding'), rows)}\n\n{', '.join(f'{n} {state}' for state, n in count.items())}"


def versions() -> Iterator[Finding]:
    """Yield Python, the machine, and the versions of opir and of its libraries."""
    machine = (
        f"{platform.system()} {platform.release()} {platform.machine()}, {os.cpu_count()} cores"
    )
    yield Finding("python", OK, f"{platform.python_version()} on {machine}")
    known = ", ".join(f"{name} {_version(name)}" for name in _LIBRARIES)
    yield Finding("versions", OK, f"opir-core {__version__}, {known}")


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "(not installed)"


def plugins() -> Iterator[Finding]:
    """Yield the plugins that are ready, those that failed, names with several owners, and packages
    not installed.
    """
    host = Host.discover()
    rows = host.catalogue()
    ready = sorted(
        {
            row.distribution
            for row in rows
            if row.state == "ready" and row.distribution != "opir-core"
        }
    )
    yield Finding("plugins", OK, ", ".join(ready) or "none beside opir-core")
    for row in rows:
        if row.state == "failed":
            reason = " ".join(row.failure.split())
            yield Finding(
                "plugins", FAIL, f"{row.distribution} {row.version} (plugin {row.plugin}): {reason}"
            )
        elif row.state != "ready":
            yield Finding(
                "plugins",
                WARN,
                f"{row.plugin}: {row.state} (OPIR_PLUGINS leaves it out, or it is missing)",
            )
    for (hook, name), owners in sorted(host.registry.claims().items()):
        if len(owners) > 1:
            yield Finding("plugins", WARN, " ".join(contested(Search(hook, name), owners).split()))
    missing = sorted(set(PACKAGES) - {row.distribution for row in rows})
    if missing:
        yield Finding("plugins", OK, f"not installed: {', '.join(missing)}")


def limits() -> Iterator[Finding]:
    """Yield the limits of the process: memory, open files, size of files."""
    memory = _available_memory()
    if memory is not None:
        state = OK if memory >= _LEAST_FREE else WARN
        yield Finding("memory", state, f"{memory / _GIB:.1f} GiB available")
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    enough = files == resource.RLIM_INFINITY or files >= _FILES
    words = "" if enough else f"; a service with many viewers needs more: ulimit -n {4 * _FILES}"
    yield Finding("open files", OK if enough else WARN, f"at most {_limit(files)}{words}")
    size, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    limited = size != resource.RLIM_INFINITY
    words = "; events and spools end there: ulimit -f unlimited" if limited else ""
    yield Finding(
        "file size",
        WARN if limited else OK,
        f"at most {_limit(size)}{' bytes' if limited else ''}{words}",
    )


def _limit(value: int) -> str:
    return "unlimited" if value == resource.RLIM_INFINITY else str(value)


def _available_memory() -> int | None:
    """Return the available memory, bytes, at most what the control group leaves; None if
    unknown.
    """
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free = next(
            1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable")
        )
    except (OSError, StopIteration, ValueError):
        return None
    group = Path("/sys/fs/cgroup")
    try:
        most, used = (
            (group / name).read_text(encoding="ascii").strip()
            for name in ("memory.max", "memory.current")
        )
        return free if most == "max" else min(free, int(most) - int(used))
    except (OSError, ValueError):
        return free


def clock() -> Iterator[Finding]:
    """Yield the time of day and the resolution of the clocks that pace live runs."""
    now_s = time.time()
    tick_s = time.get_clock_info("monotonic").resolution
    shown = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(now_s))
    if now_s < _RELEASED_S:
        yield Finding(
            "clock", WARN, f"{shown} is before this release: set the clock, or --epoch-now is wrong"
        )
    else:
        yield Finding("clock", OK, f"{shown}, monotonic to {tick_s * 1e9:.0f} ns")


def ports(port: int) -> Iterator[Finding]:
    """Yield whether `opir serve` can listen on a port of the loopback interface."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind(("127.0.0.1", port))
        yield Finding("port", OK, f"{port} is free")
    except OverflowError:
        yield Finding("port", FAIL, f"{port} is no port: 0 to 65535")
    except OSError as error:
        taken = error.errno == errno.EADDRINUSE
        words = (
            "is in use: opir serve --port 0 takes a free one"
            if taken
            else f"cannot be used: {reason_of(error)}"
        )
        yield Finding("port", WARN, f"{port} {words}")


def folder(place: Path, area: str = "disk") -> Iterator[Finding]:
    """Yield whether a folder can be written, and how much room there is."""
    if not place.is_dir():
        yield Finding(area, FAIL, f"{place}: no such folder; create it")
        return
    shown = place.resolve()
    if not os.access(place, os.W_OK | os.X_OK):
        yield Finding(
            area,
            FAIL,
            f"{shown} cannot be written by this user; choose another folder, or change its owner",
        )
        return
    free = shutil.disk_usage(place).free
    words = "" if free >= _LEAST_FREE else "; 1 GiB holds some two million events"
    yield Finding(
        area, OK if free >= _LEAST_FREE else WARN, f"{shown}: {free / _GIB:.1f} GiB free{words}"
    )


def outputs(scene: str) -> Iterator[Finding]:
    """Yield the state of a scene: whether it is valid, and the files and spools of its outputs."""
    try:
        read = load_scene(scene, host=Host.discover())
    except OpirError as error:
        yield Finding("scene", FAIL, "; ".join(line.strip() for line in str(error).splitlines()))
        return
    yield Finding("scene", OK, f"{read.name}: {len(read.outputs)} outputs")
    for choice in read.outputs:
        yield from _output(choice)


def _output(choice: Choice) -> Iterator[Finding]:
    area = f"{choice.path} ({choice.name})"
    path = getattr(choice.config, "path", None)
    if path and path != "-":
        yield from folder(Path(path).parent, area)
    if choice.spool is None:
        yield Finding(f"{area} spool", OK, WITHOUT_SPOOL)
        return
    spool = Path(choice.spool.path)
    yield from folder(spool.parent, f"{area} spool")
    held = spool.stat().st_size if spool.is_file() else 0
    full = held >= choice.spool.max_bytes
    words = (
        f"full: when_full is {choice.spool.when_full}"
        if full
        else f"of at most {choice.spool.max_bytes / _GIB:.1f} GiB"
    )
    yield Finding(
        f"{area} spool", WARN if full else OK, f"{spool}: {held / (1 << 20):.1f} MiB {words}"
    )
