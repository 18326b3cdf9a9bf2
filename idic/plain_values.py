"""Values as JSON holds them."""

from __future__ import annotations

import math
from typing import Any


def finite(value: Any) -> Any:
    """Plain values for JSON: NaN and infinities become None, numbers of NumPy those of Python, tuples lists."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if type(value).__module__ == "numpy" and not getattr(value, "ndim", 1):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
