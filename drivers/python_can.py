"""The packages python-can and cantools, without what the former would load for log files that nothing here writes.

It loads asammdf, with pandas and pyarrow, wherever that is installed: 0.6 s of each process that starts.
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
    import cantools
    from cantools.database import Database
    from cantools.database.can import Message
    from cantools.database.errors import Error as CantoolsError
finally:
    if _hidden:
        del _modules["asammdf"]

__all__ = ["CantoolsError", "Database", "Message", "can", "cantools"]
