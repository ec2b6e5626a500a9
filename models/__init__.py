"""Pure mathematics of the test bench: arrays in, arrays out."""

import os

from models.compiled_cache import keep_apart

# Before any file of this package loads numba, which reads its settings once.
keep_apart(os.path.dirname(os.path.abspath(__file__)))
