"""The private key of the driver for a TLS cluster: used only where nobody else can read it."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from pathlib import Path

from idic.errors import InputError

_OURS, _ROOTS = 0o077, 0o027  # forbidden bits of a key that we own, and of one that root owns (a mounted secret)


def check_client_key(config: Mapping) -> None:
    """Refuse the private key of the Dask configuration where others can read it.

    As PostgreSQL does: mode 600 or less for a key of our own; 640 or less for one of root, which is how containers and
    clusters mount secrets. Systems without such rights are not asked.

    config : the tables under ``distributed.comm.tls`` of the Dask configuration

    Raises
    ------
    InputError
        The key is readable for others, or is not there.
    """
    named = (config.get("client") or {}).get("key")
    if not named or "-----BEGIN" in str(named) or os.name != "posix":
        return
    path = Path(named).expanduser()
    try:
        found = path.stat()
    except OSError as problem:
        raise InputError("the private key for the Dask cluster cannot be read", file=path,
                         key="distributed.comm.tls.client.key", expected="a file", found=problem.strerror,
                         remedy="correct the Dask configuration (see deploy/README.md)") from None
    mode = stat.S_IMODE(found.st_mode)
    if mode & (_ROOTS if found.st_uid == 0 else _OURS):
        raise InputError("a private key that others can read", file=path, key="distributed.comm.tls.client.key",
                         expected="mode 600" + (" or 640, as it belongs to root" if found.st_uid == 0 else ""),
                         found=f"mode {mode:o}",
                         remedy=f"chmod 600 {path}; if others may have read it already, make new certificates: whoever "
                                "has the key can run code on the cluster")
