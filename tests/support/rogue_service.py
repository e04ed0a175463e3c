"""`opir` as a process with the component `rogue`: `python rogue_service.py HOOK SOUND METHOD DEED
WORDS...`.

The deed is `hang`, or the name of an exception.
"""

import builtins
import sys

from rogue_components import Hang, raising, rogue_host

from opir_core.cli.main import main
from opir_core.host.host import Host

if __name__ == "__main__":
    hook, sound, method, name, *words = sys.argv[1:]
    host = rogue_host(
        hook, sound, method, Hang() if name == "hang" else raising(getattr(builtins, name)())
    )
    Host.discover = classmethod(lambda _cls, *_given: host)
    sys.exit(main(words))
