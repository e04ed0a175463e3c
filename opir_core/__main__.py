"""`python -m opir_core` is `opir`."""

import sys

from opir_core.cli.main import main

sys.exit(main())
