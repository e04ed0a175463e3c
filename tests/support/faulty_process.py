"""`opir` as a process to be killed, as in `serve_process.py`, whose disk fails on request.

The process reads commands from a pipe with a name: `fail NUMBER ERROR LASTS KIND,...` and `heal`.
"""

import os
import threading
from pathlib import Path

import serve_process
from failing_disk import FailingDisk

IMPORTED = serve_process.IMPORTED


def opir(log, folder, control, *words):
    """Be `opir` with these words, on a disk with the files of a folder; commands come from the pipe
    `control`.
    """
    disk = FailingDisk(Path(folder))
    threading.Thread(target=_obey, args=(disk, control), daemon=True).start()
    with disk:
        serve_process.opir(log, *words)


def _obey(disk, control):
    # Open for writing too, so that the pipe never ends.
    with os.fdopen(os.open(control, os.O_RDWR), "rb", buffering=0) as commands:
        for line in iter(commands.readline, b""):
            command, *words = line.decode().split()
            if command == "heal":
                disk.heal()
            else:
                number, error, lasts, kinds = words
                disk.fail_at(int(number), int(error), lasts=lasts == "True", kinds=kinds.split(","))


def tell(control, *words):
    """Send a command; a process that has ended gets nothing."""
    descriptor = os.open(control, os.O_RDWR | os.O_NONBLOCK)
    try:
        os.write(descriptor, (" ".join(map(str, words)) + "\n").encode())
    finally:
        os.close(descriptor)
