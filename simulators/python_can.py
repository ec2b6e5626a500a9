"""The package python-can, without what it would load for log files that nothing here writes.

It loads asammdf, with pandas and pyarrow, wherever that is installed: 0.6 s of each process that starts. Of its own,
because simulators share nothing with the drivers but the device map.
"""

from __future__ import annotations

import sys
from typing import Any

_modules: dict[str, Any] = sys.modules
_hidden = "asammdf" not in _modules
if _hidden:
    _modules["asammdf"] = None  # what the import system takes for a package that is not there
try:
    import can
finally:
    if _hidden:
        del _modules["asammdf"]

__all__ = ["can"]
