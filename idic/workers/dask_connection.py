"""An existing Dask scheduler: over TLS on another machine, with a private key that only its owner can read."""

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
# mode bits that a private key must not have: a key of our own, and one of root (a mounted secret)
_FORBIDDEN_OURS, _FORBIDDEN_ROOTS = 0o077, 0o027


@contextmanager
def connected(scheduler: str) -> Iterator:
    """A `distributed.Client` of an existing scheduler, for the length of a ``with`` block.

    Raises
    ------
    InputError
        No scheduler at that address, or none with workers; an address outside this machine without encryption.
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
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)  # they may be starting just now
        except TimeoutError:
            raise InputError(
                "the Dask scheduler has no workers", key="--scheduler", expected=f"one within {CONNECT_SECONDS} s",
                found=address, remedy="start workers:  dask worker ADDRESS"
            ) from None
        yield client


def checked_address(address: str) -> str:
    """The address with its protocol; refused where it leaves this machine without encryption.

    Everybody who reaches a Dask scheduler or worker can run any code as its user; only TLS certificates prevent it.
    """
    protocol, _, rest = address.rpartition("://")
    protocol = protocol or "tcp"
    host = rest.rsplit(":", 1)[0].strip("[]")
    if protocol != "tls" and not _is_loopback(host):
        raise InputError(
            "a Dask scheduler on another machine is used over TLS only",
            key="--scheduler",
            expected=f"tls://{rest}, or an address on {LOOPBACK}",
            found=address,
            remedy="start scheduler and workers with --tls-ca-file, --tls-cert and --tls-key (see deploy/README.md)",
        )
    return f"{protocol}://{rest}"


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


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
    if mode & (_FORBIDDEN_ROOTS if found.st_uid == 0 else _FORBIDDEN_OURS):
        raise InputError("a private key that others can read", file=path, key="distributed.comm.tls.client.key",
                         expected="mode 600" + (" or 640, as it belongs to root" if found.st_uid == 0 else ""),
                         found=f"mode {mode:o}",
                         remedy=f"chmod 600 {path}; if others may have read it, make new certificates: with the "
                                "key they can run code on the cluster")
