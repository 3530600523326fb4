"""What tests of the diagnosis share."""

from __future__ import annotations

import pytest


@pytest.fixture
def asked(monkeypatch):
    """How often it was asked what is left beside named effects, which takes five times as long as to name them; nothing
    is learned of it."""
    calls = []
    monkeypatch.setattr("mazeplan.diagnosis.ring.diagnose.remainder", lambda *arguments: calls.append(arguments))
    return calls
