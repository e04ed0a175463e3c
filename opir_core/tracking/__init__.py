"""From detections to tracks: association, filters, track management and the metrics that judge them.

Nothing here is imported unless a scene names a tracker that needs it, and nothing here ever sees truth.
"""
