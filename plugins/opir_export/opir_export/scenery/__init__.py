"""What maps and ephemerides of a run show: paths, footprints, regions."""
