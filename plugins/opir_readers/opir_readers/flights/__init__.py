"""Flights of other programs: exports of rocket simulators, webcast telemetry, GPX and KML
tracks.
"""
