"""For plugin authors: conformance tests to inherit, test doubles, and a pytest plugin.

Each name is imported when it is first used, so that the pytest plugin is cheap without conformance
tests.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
