"""The version of `opir-core`: read by the build and by the command line, and kept free of
imports.
"""

__version__ = "0.1.0"
