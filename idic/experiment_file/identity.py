"""The fingerprint of an experiment: what decides its result, and nothing else."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

_SAMPLE = 1 << 16  # bytes hashed at each end of an image; two different images that agree in both ends are not expected


def fingerprint(raw: Mapping, files: Iterable[Path], images: Iterable[Path]) -> str:
    """sha256 over the tables (without title and [setup]), whole small files, name, size and both ends of every image."""
    digest = hashlib.sha256(b"idic.experiment/1\n")
    tables = {name: value for name, value in raw.items() if name != "setup"}
    tables["experiment"] = {key: value for key, value in dict(raw.get("experiment", {})).items() if key != "title"}
    digest.update(json.dumps(tables, sort_keys=True, default=str).encode())
    for path in files:
        digest.update(f"\nfile {path.name} ".encode() + hashlib.sha256(path.read_bytes()).digest())
    for path in images:
        size = path.stat().st_size
        with path.open("rb") as stream:
            head = stream.read(_SAMPLE)
            stream.seek(max(size - _SAMPLE, 0))
            tail = stream.read(_SAMPLE)
        digest.update(f"\nimage {path.name} {size} ".encode() + hashlib.sha256(head + tail).digest())
    return digest.hexdigest()
