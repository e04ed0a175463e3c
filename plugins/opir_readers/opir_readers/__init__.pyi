from opir_readers.celestial_frames import (
    ecef_state as ecef_state,
)
