"""Civil geostationary imagers, `GOES-ABI`, `AHI` and `MTG-FCI`, as sensor models, with published
bands, noise and cadence.
"""
