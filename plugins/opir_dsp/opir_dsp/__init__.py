"""The `DSP` sensor model and its default constellation: a spinning long-wave scanner."""
