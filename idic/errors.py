"""The two ways in which idic stops: the user must act, or the caller may retry."""

from __future__ import annotations

_MAX_LENGTH = 600  # characters of one line of a message


class InputError(Exception):
    """The user must act: something in the input is not what was expected (exit code 2).

    Parameters
    ----------
    what : str
        One sentence: what is wrong.
    file, key : str, optional
        Where it was found: the file and the key, column or line in it.
    expected, found, remedy : str, optional
        What was expected, what was found instead, what to do.
    """

    def __init__(self, what: str, *, file=None, key=None, expected=None, found=None, remedy=None):
        self.what, self.file, self.key = what, file, key
        self.expected, self.found, self.remedy = expected, found, remedy
        super().__init__(what)

    def __str__(self) -> str:
        place = ": ".join(str(part) for part in (self.file, self.key) if part is not None)
        lines = [_shortened(f"{place}: {self.what}" if place else self.what)]
        for label, text in (("expected", self.expected), ("found", self.found), ("what to do", self.remedy)):
            if text is not None:
                lines.append(f"  {label}: {_shortened(str(text))}")
        return "\n".join(lines)

    def __reduce__(self):  # crosses process boundaries (Dask workers) with its fields
        return _rebuild_input_error, (self.what, self.file, self.key, self.expected, self.found, self.remedy)


def _shortened(text: str) -> str:
    """A long text without its middle: a damaged file may hold lines of any length."""
    return text if len(text) <= _MAX_LENGTH else f"{text[:_MAX_LENGTH // 2]} … {text[-_MAX_LENGTH // 4:]}"


def _rebuild_input_error(what, file, key, expected, found, remedy):
    return InputError(what, file=file, key=key, expected=expected, found=found, remedy=remedy)


class NotConverged(Exception):
    """A simulation did not reach equilibrium; the caller may retry with smaller steps or other parameters.

    time, frame : the time (s) and the frame that were reached, where the simulation knows them
    """

    time: float | None = None
    frame: int | None = None


class GaveUp(NotConverged):
    """A simulation needs more evaluations than its caller allows; other increments are not tried."""
