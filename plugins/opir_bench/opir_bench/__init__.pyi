from opir_bench.bands import (
    BandLimits as BandLimits,
    best_bands as best_bands,
)
from opir_bench.movie_files import (
    write_movies as write_movies,
)
from opir_bench.movies import (
    Clip as Clip,
    Filming as Filming,
    clip as clip,
)
from opir_bench.stand import (
    Bench as Bench,
    Poses as Poses,
)
