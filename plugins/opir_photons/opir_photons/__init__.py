"""Models of light for opir: sources, plumes, air, background, focal planes, detection and
classification by signal.
"""
