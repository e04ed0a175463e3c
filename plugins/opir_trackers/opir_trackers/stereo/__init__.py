"""The tracker `stereo-filter`: which line of sight is whose, tracks from first looks to last, and what they tell."""
