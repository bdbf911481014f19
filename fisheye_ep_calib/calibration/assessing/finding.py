"""One measured property of a recording, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass

_TITLES = {
    "depth": "depth at large angles",
    "near_far": "near/far split",
    "correlated_residuals": "residuals correlated within a view",
}


@dataclass(frozen=True)
class Finding:
    """One measured property of the recording. name: as programs know it. values: numbers by name, unit in the name.

    concern: whether it limits the calibration. sentence: what it means and what to record more of.
    """

    name: str
    values: dict[str, float]
    concern: bool
    sentence: str

    @property
    def title(self) -> str:
        """The name as a person reads it."""
        return _TITLES.get(self.name, self.name.replace("_", " "))

    @property
    def line(self) -> str:
        """Title and sentence; the sentence alone where it begins with the title."""
        begins = self.sentence.lower().removeprefix("the ").startswith(self.title.lower())
        return self.sentence if begins else f"{self.title}: {self.sentence}"
