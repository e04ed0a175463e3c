"""The commands for authors: `opir check` and `opir new-plugin`."""
