"""Stone Soup's trackers as the tracker `stonesoup`, and opir's detections as a Stone Soup reader.

The modules `models`, `reader` and `tracker` import Stone Soup; a scene imports them only if it
names the tracker.
"""
