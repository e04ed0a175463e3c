"""Civil geostationary imagers, `GOES-ABI` and `AHI`, as sensor models, with published bands, noise
and cadence.
"""
