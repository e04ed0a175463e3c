"""Detection: thresholds in Gaussian noise, rules over several bands, and what is measured where they are passed."""
