"""A preload of `dask worker`: this process sees nothing below the folders of the variable BLIND_TO, as on another
machine."""

import os
import sys

_FOLDERS = tuple(filter(None, os.environ.get("BLIND_TO", "").split(os.pathsep)))


def _refuse(event, arguments):
    if event in ("open", "os.listdir", "os.scandir", "os.mkdir", "os.rename", "os.remove", "os.rmdir"):
        for path in arguments[:2]:
            if isinstance(path, (str, bytes)) and os.fsdecode(path).startswith(_FOLDERS):
                with open(os.environ["BLIND_LOG"], "a") as log:
                    log.write(f"{event} {os.fsdecode(path)}\n")
                raise FileNotFoundError(2, "not on this machine", os.fsdecode(path))


if _FOLDERS:
    sys.addaudithook(_refuse)


def dask_setup(worker):
    """Called by Dask; the hook is there from the import on."""
