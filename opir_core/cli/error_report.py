"""How the command line reports an error: one message on standard error, and the exit code."""

import sys

from opir_core.cli.streams import plain_text
from opir_core.errors import ModelError, OpirError, SceneError, SinkError, reason_of
from opir_core.host.error_messages import described_error


def report(error: BaseException) -> int:
    """Print an error as one message and return its exit code; what opir did not foresee is named
    with its line.
    """
    shortage = _memory_error(error)
    if shortage is not None:
        message = (
            f"not enough memory: {described_error(shortage)}; give a shorter duration_s, fewer"
            " sensors or launches, a higher threshold, or a smaller file, or run where there is more"
        )
        code = SceneError.exit_code
    elif isinstance(error, OpirError):
        message = str(error)
        code = error.exit_code
    elif isinstance(error, OSError) and error.filename in ("<stdout>", "<stderr>"):
        message = f"{error.filename[1:-1]} cannot be written: {reason_of(error)}"
        code = SinkError.exit_code
    elif isinstance(error, SystemExit | GeneratorExit):
        # An exit that nobody asked for must not look like success.
        message = f"a component raised {described_error(error)}"
        code = ModelError.exit_code
    else:
        message = f"internal error: {described_error(error)}; with --debug the traceback is printed"
        code = 1
    sys.stderr.write(f"opir: {plain_text(message)}\n")
    return code


def _memory_error(error: BaseException | None) -> MemoryError | None:
    """Return the lack of memory that an error comes from, if it does; a component's is no fault of
    that component.
    """
    while error is not None and not isinstance(error, MemoryError):
        error = error.__cause__
    return error
