"""Shows objects of the public API as a line in a console, and as a small table in a notebook."""

import html
from abc import ABC, abstractmethod


class Presented(ABC):
    """Base of classes with a short `repr` and a small HTML table."""

    @abstractmethod
    def facts(self) -> dict[str, object]:
        """Returns the properties of the object to show: a short value for each name."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v}' for k, v in self.facts().items())})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{html.escape(k)}</th><td>{html.escape(str(v))}</td></tr>"
            for k, v in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


def extent_of(numbers: range | tuple[int, ...]) -> str:
    """Returns the number of frames, and the first and last frame number: `20 (0 to 190)`."""
    return f"{len(numbers)} ({numbers[0]} to {numbers[-1]})" if numbers else "0"
