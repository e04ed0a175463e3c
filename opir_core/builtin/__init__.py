"""The components that come with the core: one honest model of every kind that needs no plugin, and null models."""
