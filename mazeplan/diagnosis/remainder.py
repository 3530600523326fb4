"""stub"""
from __future__ import annotations
from dataclasses import dataclass
@dataclass(frozen=True)
class Remainder:
    nrmse: float
    def document(self): return {}
def remainder(*a): return None
