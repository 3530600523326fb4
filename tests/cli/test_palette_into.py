"""`behavior palette --into FILE`: the model of a tree's nodes in its file, and nothing else of it changed."""

from __future__ import annotations

import sys

import pytest
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.core import resources

TREE = '<BehaviorTree ID="Main"><Sequence><Replan/><SubTree ID="Sub"/></Sequence></BehaviorTree>'
SUB = '<BehaviorTree ID="Sub"><InRing ring="{ring}"/></BehaviorTree>'
MODEL = (
    '<TreeNodesModel><SubTree ID="Sub"><input_port name="ring" default="3"/></SubTree>'
    '<Action ID="Dither"/></TreeNodesModel>'
)
COMMENT = "<!-- <TreeNodesModel/> ends before </root> -->"
HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main">'
FILES = {
    "one line": f"{HEAD}{TREE}{SUB}{MODEL}</root>",
    "no model": f'{HEAD}{TREE}\n{SUB.replace("{ring}", "2")}\n</root>',
    "lines": f"{HEAD}\n  {TREE}\n  {SUB}\n  {MODEL}\n</root>\n",
    "comment": f"{COMMENT}\n{HEAD}\n  {TREE}\n  {SUB}\n\n  {COMMENT}\n  {MODEL}\n  </root >\n{COMMENT}",
    "two models": f'{HEAD}\n{MODEL}{TREE}\n\n<TreeNodesModel />\n{SUB}\n</root>',
    "another system's lines": f"{HEAD}\r\n  {TREE}\r\n  {SUB}\r\n  {MODEL}\r\n</root>\r\n",
}  # fmt: skip


@pytest.fixture
def module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "nodes_for_palette.py").write_text(
        "from mazeplan import Decorator, MazeLeaf, Port, Status\n"
        "class Calm(MazeLeaf):\n    ports = {'s': Port(float, 1.0, 'how <long>')}\n    def step(self): ...\n"
        "class Often(Decorator):\n    def run(self): ...\n"
    )
    yield "nodes_for_palette"
    sys.modules.pop("nodes_for_palette", None)


@pytest.mark.parametrize("kind", FILES)
def test_a_second_time_changes_no_byte(call, tmp_path, module, kind):
    file = tmp_path / "tree.xml"
    file.write_bytes(FILES[kind].encode())
    words = ("behavior", "palette", "--into", file, "--behavior-module", module)
    assert call(*words)[0] == 0
    once = file.read_bytes()
    assert call(*words)[0] == 0
    assert file.read_bytes() == once
    root = etree.fromstring(once)
    (model,) = root.findall("TreeNodesModel")
    assert [node.get("ID") for node in model if node.tag != "SubTree"] == ["Calm", "InRing", "Often", "Replan"]
    assert [node.get("ID") for node in model.iter("SubTree")] == (["Sub"] if kind != "no model" else [])
    assert model.find("Action[@ID='Calm']/input_port").text == "how <long>"
    before = FILES[kind].replace("</root>", "\n</root>")
    kept = [line for line in before.splitlines() if "TreeNodesModel" not in line or "<!--" in line]
    assert [line for line in kept if line not in once.decode()] == []
    assert once.count(b"\r\n") == (once.count(b"\n") if "another" in kind else 0)
    assert call("behavior", "check", file)[0] == 0, "a default of a SubTree counts"


def test_without_the_module_its_nodes_are_no_longer_in_it(call, tmp_path, module):
    file = tmp_path / "tree.xml"
    file.write_text(FILES["lines"])
    call("behavior", "palette", "--into", file, "--behavior-module", module)
    call("behavior", "palette", "--into", file)
    (model,) = etree.fromstring(file.read_bytes()).findall("TreeNodesModel")
    assert [node.get("ID") for node in model] == ["Sub", "InRing", "Replan"]


def test_the_packaged_trees_have_their_models_as_they_would_be_written(call, tmp_path):
    text = (resources.share("behaviors") / "navigate.xml").read_bytes()
    (tmp_path / "copy.xml").write_bytes(text)
    assert call("behavior", "palette", "--into", tmp_path / "copy.xml")[0] == 0
    assert (tmp_path / "copy.xml").read_bytes() == text


def test_a_file_that_is_none_or_no_utf_8_is_refused(refused, tmp_path):
    assert "--into: navigate: no such file; expected the XML file of a tree" in refused(
        "behavior", "palette", "--into", "navigate"
    )
    latin = f'<?xml version="1.0" encoding="latin-1"?>{HEAD}<!-- \xe9 -->{TREE}{SUB}{MODEL}</root>'
    (tmp_path / "tree.xml").write_bytes(latin.encode("latin-1"))
    assert "that is not UTF-8" in refused("behavior", "palette", "--into", tmp_path / "tree.xml")
