"""`opir` as a process to be killed, forked by `forked_processes.py` from one that has imported
everything.
"""

import json
import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import opir_http.serving
import opir_kafka.transport
from forked_processes import is_alive
from waiting import within

from opir_core.cli.main import main

IMPORTED = (opir_http.serving, opir_kafka.transport)


def opir(log, *words):
    """Be `opir` with these words; what it prints goes into the file `log`."""
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    for stream in (1, 2):
        os.dup2(descriptor, stream)
    main(words)


class Nursery:
    """Where such processes come from."""

    def __init__(self, module="serve_process"):
        doomed = str(Path(__file__).with_name("forked_processes.py"))
        command = [sys.executable, doomed, module]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._last = 0

    def born(self, log, *words):
        """Start the module's `opir` with these words; return the process's number."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"opir {json.dumps([str(log), *words])}\n")
        self._last = int(within(120.0, self._process.stdout.readline))
        return self._last

    def close(self):
        """End the nursery, and its last process if a test that failed has left it."""
        if self._last and is_alive(self._last):
            os.kill(self._last, signal.SIGKILL)
        self._process.communicate(timeout=60.0)


@contextmanager
def nursery(module="serve_process"):
    process = Nursery(module)
    try:
        yield process
    finally:
        process.close()
