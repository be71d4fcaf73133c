"""The frames of an imported recording, with what the import assumed and counted."""

from collections import Counter
from dataclasses import dataclass

from pyinfra.dataset.frame_sequence import RecordedFrames


@dataclass(eq=False, repr=False)
class ImportedFrames(RecordedFrames):
    """The frames of an imported recording.

    `assumed` lists the assumptions about the recording, `not_read` what was not read of it, and
    `types` counts the labels by type.
    """

    assumed: tuple[str, ...]
    not_read: tuple[str, ...]
    types: Counter[str]

    def facts(self) -> dict[str, object]:
        return super().facts() | {"labels": self.types.total()}
