"""What a burning or dark target may still do: boosts of the prior, matched to a track and flown on
to impacts.
"""
