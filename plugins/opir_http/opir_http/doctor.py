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

#: With less free disk or memory a long run is at risk, bytes: events of some millions of detections
#: take 1 GiB.
_GIB = 1 << 30
#: Files and sockets that a service with a few hundred viewers holds open.
_FILES = 1024
#: Earliest plausible time of day, s since 1970: that of this release. A machine without a clock
#: starts in 1970.
_RELEASED_S = 1_790_000_000.0


@frozen
class Finding:
    """One finding: the area, its state, and its text, with the way out."""

    area: str
    state: str
    text: str


def _checked(area: str, is_ok: bool, text: str, remedy: str) -> Finding:
    """Return a finding that warns, with the remedy, unless it is ok."""
    return Finding(area, OK, text) if is_ok else Finding(area, WARN, f"{text}; {remedy}")


def doctor(arguments: argparse.Namespace) -> int:
    """Print the findings; exit code 5, as for a broken component or output, if a run would fail."""
    findings = [
        *versions(),
        *plugins(),
        *limits(),
        *clock(),
        *ports(arguments.port),
        *folder(Path()),
    ]
    if arguments.scene is not None:
        findings += outputs(arguments.scene)
    plain = [asdict(finding) for finding in findings]
    text = json.dumps(plain, indent=2) if arguments.json else _text(findings)
    sys.stdout.write(text + "\n")
    return 5 if any(finding.state == FAIL for finding in findings) else 0


def _text(findings: Sequence[Finding]) -> str:
    rows = [(finding.state, finding.area, finding.text) for finding in findings]
    states = [finding.state for finding in findings]
    counts = ", ".join(f"{states.count(state)} {state}" for state in (OK, WARN, FAIL))
    return f"{table(('state', 'area', 'finding'), rows)}\n\n{counts}"


def versions() -> Iterator[Finding]:
    """Yield Python, the machine, and the versions of opir and of its libraries."""
    machine = (
        f"{platform.system()} {platform.release()} {platform.machine()}, {os.cpu_count()} cores"
    )
    yield Finding("python", OK, f"{platform.python_version()} on {machine}")
    libraries = ", ".join(f"{name} {_version(name)}" for name in _LIBRARIES)
    yield Finding("versions", OK, f"opir-core {__version__}, {libraries}")


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
        state = OK if memory >= _GIB else WARN
        yield Finding("memory", state, f"{memory / _GIB:.1f} GiB available")
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    yield _checked(
        "open files",
        files == resource.RLIM_INFINITY or files >= _FILES,
        f"at most {_limit(files)}",
        f"a service with many viewers needs more: ulimit -n {4 * _FILES}",
    )
    size, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    is_unlimited = size == resource.RLIM_INFINITY
    yield _checked(
        "file size",
        is_unlimited,
        f"at most {_limit(size)}{'' if is_unlimited else ' bytes'}",
        "events and spools end there: ulimit -f unlimited",
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
        limit, usage = (
            (group / name).read_text(encoding="ascii").strip()
            for name in ("memory.max", "memory.current")
        )
        return free if limit == "max" else min(free, int(limit) - int(usage))
    except (OSError, ValueError):
        return free


def clock() -> Iterator[Finding]:
    """Yield the time of day and the resolution of the clocks that pace live runs."""
    time_s = time.time()
    text = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(time_s))
    if time_s < _RELEASED_S:
        words = "is before this release: set the clock, or --epoch-now is wrong"
        yield Finding("clock", WARN, f"{text} {words}")
    else:
        resolution_ns = time.get_clock_info("monotonic").resolution * 1e9
        yield Finding("clock", OK, f"{text}, monotonic to {resolution_ns:.0f} ns")


def ports(port: int) -> Iterator[Finding]:
    """Yield whether `opir serve` can listen on a port of the loopback interface."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(("127.0.0.1", port))
        yield Finding("port", OK, f"{port} is free")
    except OverflowError:
        yield Finding("port", FAIL, f"{port} is no port: 0 to 65535")
    except OSError as error:
        words = f"cannot be used: {reason_of(error)}"
        if error.errno == errno.EADDRINUSE:
            words = "is in use: opir serve --port 0 takes a free one"
        yield Finding("port", WARN, f"{port} {words}")


def folder(place: Path, area: str = "disk") -> Iterator[Finding]:
    """Yield whether a folder can be written, and how much room there is."""
    if not place.is_dir():
        yield Finding(area, FAIL, f"{place}: no such folder; create it")
        return
    path = place.resolve()
    if not os.access(place, os.W_OK | os.X_OK):
        words = "cannot be written by this user; choose another folder, or change its owner"
        yield Finding(area, FAIL, f"{path} {words}")
        return
    free = shutil.disk_usage(place).free
    text = f"{path}: {free / _GIB:.1f} GiB free"
    yield _checked(area, free >= _GIB, text, "1 GiB holds some two million events")


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
    size = spool.stat().st_size if spool.is_file() else 0
    is_full = size >= choice.spool.max_bytes
    limit = f"of at most {choice.spool.max_bytes / _GIB:.1f} GiB"
    words = f"full: when_full is {choice.spool.when_full}" if is_full else limit
    text = f"{spool}: {size / (1 << 20):.1f} MiB {words}"
    yield Finding(f"{area} spool", WARN if is_full else OK, text)
