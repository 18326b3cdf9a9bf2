"""Parts of a diagnosis that may fail without costing its verdict: advice, figures, pages."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from idic.errors import InputError, NotConverged


class Notes:
    """What failed beside the verdict, in sentences (`told`)."""

    def __init__(self, texts: Sequence[str] = ()):
        self.texts = list(texts)

    def attempt(self, part: str, compute: Callable[..., Any], *arguments: Any, otherwise: Any = None) -> Any:
        """The answer of `compute`, or `otherwise` and a note where it fails.

        part : the part, "the page"
        """
        try:
            return compute(*arguments)
        except (InputError, NotConverged) as problem:
            self.texts.append(f"Without {part}: {problem}. The verdict does not depend on it.")
        except Exception as problem:  # noqa: BLE001 - a bug: the verdict stands, and the note says how to find it
            frame = traceback.extract_tb(problem.__traceback__)[-1]
            self.texts.append(f"Without {part}: {type(problem).__name__}, {problem} ({Path(frame.filename).name}, line "
                             f"{frame.lineno}). The verdict does not depend on it. This is a bug in idic: please "
                             f"report it.")
        return otherwise
