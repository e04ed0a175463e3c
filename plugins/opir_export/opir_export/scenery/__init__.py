"""Contents of the maps of a run: paths, footprints, regions."""
