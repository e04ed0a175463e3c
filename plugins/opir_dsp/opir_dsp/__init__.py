"""The `DSP` sensor model and its default constellation."""
