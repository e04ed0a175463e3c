"""The exporters, one module for each family of formats."""
