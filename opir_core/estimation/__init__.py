"""What trackers and the bounds of scoring share: square-root filters, motion models and lines of sight."""
