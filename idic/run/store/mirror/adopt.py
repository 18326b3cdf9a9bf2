"""Writes the files of a worker into the RUN, whole groups at once, as if the worker had written there."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from idic.inside import folder_inside, write_inside
from idic.run.store.mirror.manifest import Entry, Manifest, Scanner, inside
from idic.run.store.run_store import renamed_when_complete


def adopt(area: Path, files: Manifest, read: Callable[[Entry], bytes], scanner: Scanner) -> None:
    """Write the files of a task.

    Parameters
    ----------
    area : the folder of the driver that the paths begin at
    files : by their paths below it
    read : the checked content of a file
    scanner : told about every file
    """
    groups = _finished_groups(files, read)
    for group in groups:
        target = inside(area, group)
        group_files = {key: entry for key, entry in files.items() if key.startswith(f"{group}/")}
        with renamed_when_complete(target) as folder:
            for key, entry in group_files.items():
                _write(folder, key[len(group) + 1:], read(entry))
        for key, entry in group_files.items():
            scanner.expect(str(area / key), entry)
    for key, entry in files.items():
        if not any(key.startswith(f"{group}/") for group in groups):
            path = inside(area, key)
            _write(area, key, read(entry))
            scanner.expect(str(path), entry)


def _finished_groups(files: Manifest, read: Callable[[Entry], bytes]) -> list[str]:
    """Folders that are finished groups of a store; a group that the driver is building is none."""
    groups = []
    for key, entry in files.items():
        folder, _, name = key.rpartition("/")
        if name == "zarr.json" and not os.path.basename(folder).startswith("."):
            description = json.loads(read(entry))
            if description.get("node_type") == "group" and description.get("attributes", {}).get("finished"):
                groups.append(folder)
    return groups


def _write(folder: Path, key: str, content: bytes) -> None:
    folder_inside(folder, PurePosixPath(key).parent)
    write_inside(folder, key, content)
