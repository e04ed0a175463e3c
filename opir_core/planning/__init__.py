"""From a scene to a plan: components built, trajectories computed, and who can see whom when."""
