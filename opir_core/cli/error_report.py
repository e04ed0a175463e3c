"""How the command line reports an error: one message on standard error, and the exit code."""

import sys

from opir_core.cli.streams import plain_text
from opir_core.errors import ModelError, OpirError, SinkError, reason_of
from opir_core.host.error_messages import described_error


def report(error: BaseException) -> int:
    """Print an error as one message and return its exit code; what opir did not foresee is named
    with its line.
    """
    if isinstance(error, OpirError):
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
