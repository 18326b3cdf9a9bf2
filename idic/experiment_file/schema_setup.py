"""[setup]: what images cannot tell of the laboratory, for the good-practice table of the report; decides nothing."""

from __future__ import annotations

from idic.experiment_file.schema_base import Strict


class SetupTable(Strict):
    """All of it in words with units, as it is to stand in the report."""

    camera: str | None = None
    lens: str | None = None
    aperture: str | None = None
    stand_off: str | None = None
    exposure: str | None = None
    lighting: str | None = None
    pattern: str | None = None  # how it was made: "black spray on white"
    specimen: str | None = None
    machine: str | None = None

    @property
    def stated(self) -> dict[str, str]:
        """What was given."""
        return {name: text for name in type(self).model_fields if (text := getattr(self, name))}
