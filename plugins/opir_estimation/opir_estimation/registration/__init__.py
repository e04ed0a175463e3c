"""Registration: what the lines of sight of all tracks together say of the sensors: biases, clocks,
noise.
"""
