"""Settings of a session as the JSON that the extension module reads."""

import json
import os
from typing import Any


def _plain(value: Any) -> Any:
    """Numpy's arrays and numbers as lists and numbers, paths as text."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return os.fspath(value)


def as_json(settings: dict[str, Any]) -> str:
    return json.dumps(settings, default=_plain)
