"""How the plant's functions are compiled."""

import os

from numba import njit

# Numba takes a compiled function from its store if the function's own file is unchanged, whatever became of the files
# of the functions that it calls. So nothing is stored unless somebody names a folder, which should begin empty.
compiled = njit(cache="NUMBA_CACHE_DIR" in os.environ)
