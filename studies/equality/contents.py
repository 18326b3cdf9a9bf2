"""What is kept of the folders that a case leaves: documents, tables, pages, decoded arrays, names of files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
import zarr

from idic_studies.equality.normal_text import normal, page_paragraphs

DOCUMENTS = frozenset({"result.json", "diagnosis.json", "design.json", "systematic.json", "truth.json"})
TABLES = frozenset({".csv", ".toml", ".inp"})
PAGES = frozenset({".html"})
NOT_COMPARED = frozenset({"cost", "sha256"})  # keys of documents: times and memory, and the sum over all others
INTERNAL_FILES = frozenset({"run.lock"})  # held by the process of a run
INTERNAL_SUFFIXES = frozenset({".npz"})  # finished steps of a diagnosis, for --resume
IMAGES = frozenset({".tif", ".tiff"})
ARRAY_METADATA = "zarr.json"


def output_content(folder: Path, case: Path) -> tuple[dict[str, Any], dict[str, list[str]], list[str]]:
    """Documents, texts by lines or paragraphs, and names of all files of a folder; case : the folder of the case."""
    documents, texts, names = {}, {}, []
    for file in _files(folder):
        name = file.relative_to(case).as_posix()
        names.append(name)
        if file.name in DOCUMENTS:
            documents[name] = _normal_document(json.loads(file.read_text(encoding="utf-8")), case)
        elif file.suffix in PAGES:
            texts[name] = [normal(text, case) for text in page_paragraphs(file.read_text(encoding="utf-8"))]
        elif file.suffix in TABLES:
            texts[name] = normal(file.read_text(encoding="utf-8"), case).splitlines()
    return documents, texts, names


def input_sums(folder: Path, case: Path) -> dict[str, str]:
    """The sum of every file of an experiment: of the pixels of an image, of the normal text of any other."""
    sums = {}
    for file in _files(folder):
        content = (_array_bytes(tifffile.imread(file)) if file.suffix in IMAGES
                   else normal(file.read_text(encoding="utf-8"), case).encode())
        sums[file.relative_to(case).as_posix()] = hashlib.sha256(content).hexdigest()
    return sums


def stored_arrays(folder: Path, case: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Every decoded array below a folder, by its path."""
    for file in sorted(folder.rglob(ARRAY_METADATA)):
        if json.loads(file.read_text(encoding="utf-8")).get("node_type") == "array":
            array: Any = zarr.open_array(file.parent, mode="r")
            yield file.parent.relative_to(case).as_posix(), np.asarray(array[...])


def array_record(array: np.ndarray) -> dict[str, Any]:
    """Shape, type, sum of all bits, and two numbers for another machine: the largest and the mean square magnitude."""
    record: dict[str, Any] = {"shape": list(array.shape), "dtype": array.dtype.str,
                              "sha256": hashlib.sha256(_array_bytes(array)).hexdigest()}
    if array.size and array.dtype.kind in "fiub":
        finite = np.abs(array[np.isfinite(array)].astype(float))
        record |= {"largest": float(finite.max(initial=0.0)),
                   "rms": float(np.sqrt(np.mean(finite**2))) if finite.size else 0.0}
    return record


def _files(folder: Path) -> Iterator[Path]:
    """The files of a folder but those inside of stored arrays."""
    for file in sorted(folder.rglob("*")):
        stored = any(part.endswith(".zarr") for part in file.relative_to(folder).parts)
        internal = file.name in INTERNAL_FILES or file.suffix in INTERNAL_SUFFIXES
        if file.is_file() and not stored and not internal:
            yield file


def _array_bytes(array: np.ndarray) -> bytes:
    return np.ascontiguousarray(array).tobytes()


def _normal_document(content: Any, case: Path) -> Any:
    if isinstance(content, dict):
        return {key: _normal_document(value, case) for key, value in content.items() if key not in NOT_COMPARED}
    if isinstance(content, list):
        return [_normal_document(value, case) for value in content]
    return normal(content, case) if isinstance(content, str) else content
