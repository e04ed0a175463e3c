"""Estimation shared by the trackers and the bounds of scoring: square-root filters, motion models, lines of sight."""
