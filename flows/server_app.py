"""The application of our Prefect server: it answers to this machine's own names only.

A web page elsewhere may let its own name point to 127.0.0.1 (DNS rebinding); its requests carry that name as their
host.
"""

from __future__ import annotations

import gc
from typing import Any

HOSTS = ["127.0.0.1", "localhost"]


def create_app() -> Any:
    """The ASGI application, for ``uvicorn --factory``."""
    gc.disable()  # Prefect makes a million objects that stay: looking through them takes a tenth of the start
    try:
        from fastapi.middleware.trustedhost import TrustedHostMiddleware
        from prefect.server.api.server import create_app as create_prefect

        return TrustedHostMiddleware(create_prefect(), allowed_hosts=HOSTS)
    finally:
        gc.freeze()
        gc.enable()
