"""The commands of the core, each a function of the parsed arguments that returns the exit code."""
