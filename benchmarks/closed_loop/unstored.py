"""How functions are compiled whose records have another layout for each number of joints.

Numba names a stored function by its arguments' types, and records by a number that each process counts for itself. So
what two processes stored for two layouts may bear one name; a third that loads both runs one of them on the other's
records (seen with 0.68.1: arms of 5 and of 6 joints). Nothing is stored here. The plant's records have one layout.
"""

from numba import njit

compiled = njit
