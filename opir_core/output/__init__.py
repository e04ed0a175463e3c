"""From windows to sinks: encoders, the pump, the spool and the truth file."""
