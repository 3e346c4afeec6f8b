"""How the plant's functions are compiled."""

import os

from numba import njit

# Numba reuses a stored function if the function's own file is unchanged, even if the functions that it calls have
# changed. So nothing is stored unless the user names a folder, which should be empty at first.
compiled = njit(cache="NUMBA_CACHE_DIR" in os.environ)
