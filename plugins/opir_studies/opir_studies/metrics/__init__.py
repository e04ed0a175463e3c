"""The standard metrics of studies."""
