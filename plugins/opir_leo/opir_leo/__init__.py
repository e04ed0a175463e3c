"""The sensor models `LEO-WIDE`, `LEO-MEDIUM` and `LEO-NARROW`, and their default constellations: a
low tracking layer.
"""
