"""What Python gets from a command: a record with its document, its page, and a few words for a notebook."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

from mazeplan.core.errors import InputError

PAGES = "mazeplan.apps.report.write"  # writes pages; it stands above and is loaded by name, as a rig is
SHOWN, LONGEST = 12, 300  # most rows in a notebook, and most characters of a text


def finite(value: Any) -> Any:
    """The document as JSON can hold it: None in place of NaN and infinities, keys as text, lists in place of arrays."""
    if hasattr(value, "tolist"):  # NumPy's, which takes long to import
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class Result(ABC):
    """The result of a command. kind: of its page, as in `apps.report.inputs`"""

    kind: ClassVar[str] = ""

    @abstractmethod
    def json(self) -> dict[str, Any]:
        """The document that the command prints with `--json`."""

    def report(self, path: str | Path) -> Path:
        """Write a page (HTML) without external content, and return its path. Raises InputError."""
        import_module(PAGES).write_result(self, Path(path))
        return Path(path)

    def facts(self) -> dict[str, Any]:
        """What a notebook shows: the short entries of these."""
        return self.json()

    def _repr_html_(self) -> str:
        rows = [(name, text) for name, value in self.facts().items() if (text := _short(value))]
        cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows[:SHOWN])
        try:
            picture = import_module(PAGES).picture_of(self)
        except (InputError, ImportError):  # no file any more, or no library that draws
            picture = ""
        shown = f'<br><img src="{picture}" style="max-width: 100%">' if picture else ""
        return f"<b>{escape(type(self).__name__)}</b><table>{cells}</table>{shown}"


@dataclass(frozen=True)
class DocumentResult(Result):
    """A result that keeps its document."""

    document: dict[str, Any] = field(repr=False)

    def json(self) -> dict[str, Any]:
        """The document that the command prints with `--json`."""
        return finite(self.document)


def _short(value: Any) -> str:
    """A number, a text, or the numbers of a small dict; empty for anything longer."""
    if isinstance(value, dict):
        parts = {key: _short(item) for key, item in value.items() if not isinstance(item, dict | list)}
        return ", ".join(f"{key} {text}" for key, text in parts.items() if text)
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return "" if value is None or isinstance(value, list) or len(text) > LONGEST else text
