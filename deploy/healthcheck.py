"""Whether what runs in this container answers: exit code 0 or 1.

HEALTHCHECK_URL   an address that must answer with 200 (the Prefect server)
HEALTHCHECK_DASK  HOST:PORT of a Dask scheduler or worker that must take a TLS connection with our certificate
neither           `import idic` works
"""

from __future__ import annotations

import os
import socket
import ssl
import sys
import urllib.request

SECONDS = 10.0


def main() -> int:
    try:
        if url := os.environ.get("HEALTHCHECK_URL"):
            return int(urllib.request.urlopen(url, timeout=SECONDS).status != 200)
        if address := os.environ.get("HEALTHCHECK_DASK"):
            return _takes_tls(*address.rsplit(":", 1))
        import idic

        return int(not idic.__version__)
    except Exception as problem:  # noqa: BLE001 - whatever it is, the container is not healthy, and the log says why
        print(f"{type(problem).__name__}: {problem}", file=sys.stderr)
        return 1


def _takes_tls(host: str, port: str) -> int:
    tls = "DASK_DISTRIBUTED__COMM__TLS__"
    context = ssl.create_default_context(ssl.Purpose.SERVER_AUTH, cafile=os.environ[f"{tls}CA_FILE"])
    context.check_hostname = False  # as Dask does: the authority signs for the cluster, not for a name
    context.load_cert_chain(os.environ[f"{tls}CLIENT__CERT"], os.environ[f"{tls}CLIENT__KEY"])
    with socket.create_connection((host, int(port)), SECONDS) as plain, context.wrap_socket(plain) as connection:
        return int(connection.version() is None)


if __name__ == "__main__":
    sys.exit(main())
