"""The library of candidate physics that is screened."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, registered


def candidate_library() -> tuple[Candidate, ...]:
    """The whole library, in the order of the families."""
    import idic.diagnose.candidates  # noqa: F401  registers every file of the package

    return registered()
