"""From a plan to windows of detections and tracks."""
