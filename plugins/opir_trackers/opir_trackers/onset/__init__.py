"""What a track is: probabilities of noise, ground source, bolide, launch and none of these, from
its lines of sight.
"""
