"""viser's scene without viser: keeps what is put into it."""

from __future__ import annotations

from types import SimpleNamespace


class Handle(SimpleNamespace):
    """Keeps what it is given; counts how often something is set."""

    sets = 0

    def __setattr__(self, name, value):
        object.__setattr__(self, "sets", self.sets + 1)
        object.__setattr__(self, name, value)


class FakeServer:
    """Of viser's scene: every add_ gives a handle under its name."""

    def __init__(self):
        self.nodes = {}
        self.scene = self

    def __getattr__(self, name):
        if not name.startswith("add_"):
            raise AttributeError(name)

        def add(path, *values, **more):
            self.nodes[path] = handle = Handle(values=values, **more)
            return handle

        return add
