"""Stone Soup's trackers behind opir's contract (`tracker: stonesoup`), and opir's detections as a Stone Soup reader.

Stone Soup is imported with the modules `models`, `reader` and `tracker`; a scene does so only by naming the tracker.
"""
