"""Sources that move or flash: ships, aircraft, trains, balloons, fire fronts, lightning, bodies that
enter the air and meteors that graze it.
"""
