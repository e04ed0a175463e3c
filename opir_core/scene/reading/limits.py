"""How large a scene may be. A scene beyond these is refused before it costs memory or time."""

#: The largest scene file, bytes.
MAXIMUM_FILE_BYTES = 16 * 2**20

#: The deepest nesting of blocks and lists.
MAXIMUM_DEPTH = 20

#: The most values (texts, numbers, blocks, lists) in a scene.
MAXIMUM_VALUES = 1_000_000

#: The most digits of a whole number.
MAXIMUM_DIGITS = 30

#: The most sensors, constellations spelled out, and the most targets.
MAXIMUM_SENSORS = 10_000
MAXIMUM_TARGETS = 50_000

#: The most blocks of sources; one block may stand for many emitters.
MAXIMUM_SOURCES = 1_000

#: The longest scene, s: thirty days.
MAXIMUM_DURATION_S = 30 * 86_400.0

#: The longest name of a scene and the longest id of a sensor or a target, characters.
MAXIMUM_NAME_LENGTH = 200
MAXIMUM_ID_LENGTH = 64

#: The most problems that one message lists; the rest are counted.
MAXIMUM_PROBLEMS = 200
