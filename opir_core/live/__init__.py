"""The live form of the engine: paced by the clock, with launches and changed settings let in between two windows."""
