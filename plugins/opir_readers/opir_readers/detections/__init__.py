"""Detections of other programs: readers of files of lines of sight, and `opir track`, which tracks
what they hold.
"""
