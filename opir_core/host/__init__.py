"""The host: hooks, components, discovery, resolution, and the boundary around what plugins raise."""
