"""The scene: what a user writes, checked, as frozen values."""
