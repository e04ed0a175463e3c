"""Trajectories given as tables of states: files read strictly, times and frames made the scene's, and interpolation."""
