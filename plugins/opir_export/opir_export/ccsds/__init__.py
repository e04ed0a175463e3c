"""Messages of the Consultative Committee for Space Data Systems: ephemerides, tracking data."""
