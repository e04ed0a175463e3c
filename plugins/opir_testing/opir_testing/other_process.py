"""A second Python process with a different hash seed, which runs the test scenes.

`python -m opir_testing.other_process` reads requests as lines of JSON and answers each with a line
of JSON. One process serves all tests of a session, so state that a component keeps between runs
shows as a difference.
"""

import atexit
import base64
import io
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from functools import cache

from opir_core.errors import ModelError
from opir_testing.bench import SceneFile, bench_host, bench_run

#: The hash seed of the process; the second one if the parent has the first.
_HASH_SEED = "20260401"
_OTHER_HASH_SEED = "7"


def events_in_other_process(scene: SceneFile, plugins: Sequence[str]) -> tuple[bytes, ...]:
    """Return the events of a scene from the other process; raises `ModelError` with its message
    if it fails.

    `plugins` are the modules of plugins that are not installed.
    """
    process = _process()
    assert process.stdin is not None
    assert process.stdout is not None
    request = {"scene": scene, "plugins": list(plugins), "path": sys.path}
    process.stdin.write(json.dumps(request) + "\n")
    process.stdin.flush()
    answer = json.loads(process.stdout.readline() or '{"error": "the process ended"}')
    if "error" in answer:
        raise ModelError(answer["error"])
    return tuple(base64.b64decode(line) for line in answer["lines"])


@cache
def _process() -> "subprocess.Popen[str]":
    seed = _OTHER_HASH_SEED if os.environ.get("PYTHONHASHSEED") == _HASH_SEED else _HASH_SEED
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        env={**os.environ, "PYTHONHASHSEED": seed},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(_end, process)
    return process


def _end(process: "subprocess.Popen[str]") -> None:
    process.communicate()


def _serve() -> None:
    answers = sys.stdout
    # What a plugin prints is no answer; another test reports it.
    sys.stdout = io.StringIO()
    for request in sys.stdin:
        arguments = json.loads(request)
        sys.path[:] = arguments["path"]
        try:
            lines = bench_run(arguments["scene"], bench_host(arguments["plugins"])).lines
            answer: dict[str, object] = {
                "lines": [base64.b64encode(line).decode() for line in lines]
            }
        except Exception as error:
            answer = {"error": str(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    _serve()
