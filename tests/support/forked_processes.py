"""Processes to be killed: started in a moment by forking one that has imported everything.

    python forked_processes.py MODULE

imports the module, then starts a process for each line `FUNCTION JSON-ARGUMENTS` and prints its
number.
"""

import json
import os
import random
import signal
import subprocess
import sys
import time
from importlib import import_module

from waiting import until, within


def main():
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    module = import_module(sys.argv[1])
    for line in sys.stdin:
        name, _, arguments = line.partition(" ")
        number = os.fork()
        if not number:
            getattr(module, name)(*json.loads(arguments))
            os._exit(0)
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()


def killed_at_random(module, function, folder, moments, longest_s, *more):
    """Run `function(folder, first, *more)` until it is killed, that many times; return how many
    events were taken.

    The function appends the number of the first event of each window of 7 to the file `taken`, once
    it is written; the next process goes on from there. Its first window is always taken.
    """
    command = [sys.executable, __file__, module]
    folk = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )
    assert folk.stdin is not None
    assert folk.stdout is not None
    rng = random.Random(moments)
    start = 0
    for _ in range(moments):
        folk.stdin.write(f"{function} {json.dumps([str(folder), start, *more])}\n")
        number = int(within(120.0, folk.stdout.readline))
        until(lambda: next_number(folder / "taken") > start)  # noqa: B023
        time.sleep(longest_s * rng.random())
        os.kill(number, signal.SIGKILL)
        until(lambda: not is_alive(number))  # noqa: B023 - read before the next is born
        start = next_number(folder / "taken")
    folk.communicate(timeout=60.0)
    return start


def next_number(path):
    numbers = path.read_bytes().split() if path.exists() else []
    return max((int(number) + 7 for number in numbers), default=0)


def is_alive(number):
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    return True


if __name__ == "__main__":
    main()
