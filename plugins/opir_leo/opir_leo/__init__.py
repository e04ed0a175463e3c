"""The sensor models `LEO-WIDE` and `LEO-MEDIUM` and their default constellations: a low tracking
layer.
"""
