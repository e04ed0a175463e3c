"""Detection: exposures to probability of detection."""
