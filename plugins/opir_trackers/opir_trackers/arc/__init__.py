"""The tracker `kepler-arc`: Keplerian arcs fitted to detections, as in the paper."""
