"""The kit that sensor packages are made of."""
