"""What a user may ask of the states of any file: smoothing, and where burns are from."""

import numpy as np
from attrs import evolve

from opir_core.plugin import StateTable


def refined(table: StateTable, noise_m: float | None, burns: str | None) -> StateTable:
    """Return a table smoothed to a noise, m, with the burns of a setting; raises `BadFileError`."""
    if noise_m:
        from opir_readers.flights.smoothing import smoothed_table

        table = smoothed_table(table, noise_m)
    if burns == "acceleration":
        from opir_readers.flights.burns import with_burns_of_acceleration

        return with_burns_of_acceleration(table)
    return (
        evolve(table, burns_s=np.array([[table.time_s[0], table.time_s[-1]]]))
        if burns == "all"
        else table
    )
