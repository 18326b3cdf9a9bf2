"""Connection to an existing Dask scheduler: TLS for other machines, and a check of the private key."""

from __future__ import annotations

import ipaddress
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from idic.errors import InputError

LOOPBACK = "127.0.0.1"
CONNECT_SECONDS = 30
# forbidden mode bits of a private key: of a key of this user, and of a key of root (a mounted secret)
_FORBIDDEN_OURS, _FORBIDDEN_ROOTS = 0o077, 0o027


@contextmanager
def connected(scheduler: str) -> Iterator:
    """A `distributed.Client` of an existing scheduler, for the length of a ``with`` block.

    Raises
    ------
    InputError
        The address has no scheduler, the scheduler has no workers, or the address is on another machine without TLS.
    """
    import dask
    import distributed

    address = checked_address(scheduler)
    if address.startswith("tls://"):
        check_client_key(dask.config.get("distributed.comm.tls", {}))
    try:
        client = distributed.Client(address, set_as_default=False, timeout=CONNECT_SECONDS)
    except (OSError, TimeoutError, ValueError, TypeError) as problem:
        raise InputError(
            "cannot connect to the Dask scheduler",
            key="--scheduler",
            expected="a running `dask scheduler`",
            found=f"{address}: {problem}",
            remedy="check the address (for tls:// also the certificates in the Dask configuration), "
            "or leave --scheduler out",
        ) from problem
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)  # they may still be starting
        except TimeoutError:
            raise InputError(
                "the Dask scheduler has no workers", key="--scheduler", expected=f"one within {CONNECT_SECONDS} s",
                found=address, remedy="start workers:  dask worker ADDRESS"
            ) from None
        yield client


def checked_address(address: str) -> str:
    """The address with its protocol; an address on another machine needs TLS.

    Any client of a Dask scheduler or worker can run code as its user; only TLS certificates prevent it.
    """
    protocol, _, location = address.rpartition("://")
    protocol = protocol or "tcp"
    host = location.rsplit(":", 1)[0].strip("[]")
    if protocol != "tls" and not _is_loopback(host):
        raise InputError(
            "a Dask scheduler on another machine is used over TLS only",
            key="--scheduler",
            expected=f"tls://{location}, or an address on {LOOPBACK}",
            found=address,
            remedy="start scheduler and workers with --tls-ca-file, --tls-cert and --tls-key (see deploy/README.md)",
        )
    return f"{protocol}://{location}"


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_client_key(config: Mapping) -> None:
    """Refuse a private key of the Dask configuration that other users can read.

    The rule is that of PostgreSQL: mode 600 or less for a key of this user; 640 or less for a key of root, as
    containers and clusters mount secrets. There is no check on systems without file modes.

    config : the tables under ``distributed.comm.tls`` of the Dask configuration

    Raises
    ------
    InputError
        Other users can read the key, or it is missing.
    """
    named = (config.get("client") or {}).get("key")
    if not named or "-----BEGIN" in str(named) or os.name != "posix":
        return
    path = Path(named).expanduser()
    try:
        status = path.stat()
    except OSError as problem:
        raise InputError("the private key for the Dask cluster cannot be read", file=path,
                         key="distributed.comm.tls.client.key", expected="a file", found=problem.strerror,
                         remedy="correct the Dask configuration (see deploy/README.md)") from None
    mode = stat.S_IMODE(status.st_mode)
    if mode & (_FORBIDDEN_ROOTS if status.st_uid == 0 else _FORBIDDEN_OURS):
        raise InputError("a private key that others can read", file=path, key="distributed.comm.tls.client.key",
                         expected="mode 600" + (" or 640, as it belongs to root" if status.st_uid == 0 else ""),
                         found=f"mode {mode:o}",
                         remedy=f"chmod 600 {path}; if others may have read it, make new certificates: with the "
                                "key they can run code on the cluster")
