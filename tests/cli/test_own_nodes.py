"""Your own control nodes, decorators and enums, in a module of the working folder."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">\n{}\n</BehaviorTree></root>'
MODULE = ("--behavior-module", "nodes")


@pytest.fixture(autouse=True)
def place(monkeypatch, tmp_path):
    """A working folder with the module of the documentation."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "trees.md").read_text()
    (example,) = re.findall(r"```python\n(from enum .*?)```", text, re.DOTALL)
    (tmp_path / "nodes.py").write_text(example)
    others = str(tmp_path.parents[1])
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if others not in folder])
    yield tmp_path
    sys.modules.pop("nodes", None)


def test_they_are_checked_shown_listed_and_in_the_palette(call, refused, place):
    xml = re.findall(r"```xml\n(<InTurn.*?)```", (ROOT / "docs" / "trees.md").read_text(), re.DOTALL)
    (place / "tree.xml").write_text(TREE.format(xml[0].replace("pace", "pace := 2; pace")))
    assert call("behavior", "check", "tree.xml", *MODULE)[1].startswith("tree.xml: ok, 4 nodes")
    assert call("behavior", "show", "tree.xml", *MODULE)[1].startswith("InTurn")
    listed = call("behavior", "list", *MODULE)[1]
    control, decorators = listed.split("control nodes:\n")[1].split("decorators:\n")
    assert "InTurn: The next child at each entry" in control
    assert "AtMost: FAILURE instead of a tick" in decorators
    assert "names that scripts know: CALM = 1, BRISK = 2" in listed
    document = json.loads(call("behavior", "list", *MODULE, "--json")[1])
    assert document["nodes"]["AtMost"]["category"] == "Decorator"
    assert document["nodes"]["AtMost"]["ports"]["entries"]["default"] == 3
    assert document["enums"] == {"CALM": 1, "BRISK": 2}
    assert "InTurn" in document["control_nodes"]
    assert "InTurn" not in document["leaves"]
    palette = call("behavior", "palette", *MODULE)[1]
    assert '<Control ID="InTurn"/>' in palette
    assert '<Decorator ID="AtMost">' in palette
    (place / "tree.xml").write_text(TREE.format("<InTurn><Dither/></InTurn>"))
    assert "InTurn: got 1 children, expected at least 2" in refused("behavior", "check", "tree.xml", *MODULE)
    (place / "tree.xml").write_text(TREE.format('<Action ID="InTurn"/>'))
    assert 'expected <Control ID="InTurn">' in refused("behavior", "check", "tree.xml", *MODULE)
