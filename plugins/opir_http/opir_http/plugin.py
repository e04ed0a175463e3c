"""The commands `opir serve`, `opir view` and `opir doctor`; web libraries are imported when they
run.
"""

from typing import Any

from opir_core.plugin import deferred, hookimpl

_SUMMARY = "run a scene in real time, with an HTTP interface and a web page"
_VIEW = "show a saved run on a web page, with a time axis"
_DOCTOR = "examine this machine and installation: versions, plugins, limits, disks, ports, outputs"


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add the three commands."""
    from opir_http.arguments import add_address, add_arguments, add_examined

    parser = commands.add_parser("serve", help=_SUMMARY)
    add_arguments(parser)
    parser.set_defaults(run=deferred("opir_http.serving.serve"), group="run")
    view = commands.add_parser("view", help=_VIEW)
    view.add_argument(
        "run_path", metavar="RUN", help="the folder of a run, or its events (opir run --out)"
    )
    add_address(view)
    view.set_defaults(run=deferred("opir_http.viewing.view"), group="look")
    doctor = commands.add_parser("doctor", help=_DOCTOR)
    add_examined(doctor)
    doctor.set_defaults(run=deferred("opir_http.doctor.doctor"), group="maintain")
