"""Messages of the Consultative Committee for Space Data Systems (CCSDS): ephemerides and tracking
data.
"""
