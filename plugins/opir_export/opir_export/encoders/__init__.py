"""Encoders of detections for consumers other than FORGE, one module each."""
