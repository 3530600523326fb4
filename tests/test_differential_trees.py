"""The comparison with BehaviorTree.CPP notices what differs. The comparison itself runs where the original was built
(tools/btcpp/README.md) and BTCPP_RUNNER names its runner."""

from __future__ import annotations

import os

import pytest
from btcpp_cases import KINDS, Case, random_case
from btcpp_corpus import texts
from btcpp_reference import Runner, difference, ours
from differential_trees import examined, main, shrunk
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'
HALTED = TREE.format('<Sequence><Check script="SF"/><Scripted script="R"/></Sequence>')
built = pytest.mark.skipif("BTCPP_RUNNER" not in os.environ, reason="BehaviorTree.CPP was not built")


class Altered(Runner):
    """A reference that does what mazeplan does but for one change of its record."""

    def __init__(self, change) -> None:
        self.change = change

    def ask(self, given):
        record = ours(
            Case(given["xml"], given["ticks"], given["board"], tuple(given["halt_before"]), tuple(given["sets"]))
        )
        self.change(record)
        return record


def test_random_trees_use_every_kind_of_node_and_condition():
    found = set()
    for seed in range(400):
        root = etree.fromstring(random_case(seed).xml)
        found |= {e.tag for e in root.iter()} | {a for e in root.iter() for a in e.attrib}
    assert found >= KINDS


def test_a_seed_gives_the_same_case_again():
    assert random_case(7) == random_case(7) != random_case(8)


@pytest.mark.parametrize(
    ("category", "change"),
    [
        ("load", lambda r: r.update(loads=False, error="no")),
        ("crash", lambda r: r.update(crash="died")),
        ("error", lambda r: r["ticks"][1].update(error="no")),
        ("status", lambda r: r["ticks"][1].update(root="SUCCESS")),
        ("status", lambda r: r["ticks"][0]["events"][0].__setitem__(2, "FAILURE")),
        ("order", lambda r: r["ticks"][1]["events"].pop(0)),
        ("halts", lambda r: r["halted"].clear()),
        ("halts", lambda r: r["ticks"][0]["events"].pop(1)),
        ("blackboard", lambda r: r["board"][0]["values"].update(k={"type": "number", "value": 1})),
    ],
)
def test_each_category_of_difference_is_noticed(category, change):
    case = Case(HALTED, 2)
    assert difference(ours(case), ours(case)) is None
    found, known = examined(case, Altered(change))
    assert found is not None
    assert known is None
    assert found.category == category


def test_a_difference_is_shrunk_to_what_it_needs():
    def change(record):
        if record["loads"] and record.get("halted"):
            record["halted"] = []

    case = Case(TREE.format(f"<Fallback><Inverter>{'<Sequence>' * 2}<Check script='SF'/><Scripted script='R' name='a'/>"
                            f"{'</Sequence>' * 2}</Inverter></Fallback>"), 8)  # fmt: skip
    found, _ = examined(case, Altered(change))
    assert found is not None
    small, _ = shrunk(case, found, Altered(change))
    root = etree.fromstring(small.xml)
    assert [e.tag for e in root.iter()] == ["root", "BehaviorTree", "Scripted"]
    assert small.ticks == 1


def test_texts_are_taken_from_literals_and_files(tmp_path):
    (tmp_path / "tests").mkdir()
    (tmp_path / "examples").mkdir()
    (tmp_path / "tests" / "a.cpp").write_text(
        'x = R"(\n  <root>1</root>)";\ny = R"xml(<root>")</root>)xml"; z = R"(no)";'
    )
    (tmp_path / "examples" / "b.xml").write_text("<root/>")
    found = [(text.place, text.xml) for text in texts(tmp_path)]
    assert found == [
        ("tests/a.cpp:1", "<root>1</root>"), ("tests/a.cpp:3", '<root>")</root>'), ("examples/b.xml", "<root/>"),
    ]  # fmt: skip


@built
def test_random_trees_do_the_same_in_mazeplan_and_in_the_original(capsys):
    for once in ([], ["--once"]):
        assert main(["--count", "250", *once]) == 0, capsys.readouterr().out


@built
def test_the_runner_survives_a_case_that_ends_its_process():
    runner = Runner()
    endless = TREE.format('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>')
    assert runner.ask(Case(endless, 1, once=True).asked()) == {"crash": "endless"}
    assert runner.ask(Case(HALTED, 1).asked())["ticks"][0]["root"] == "RUNNING"
    assert runner.ask({"xml": "<root", "ticks": 1})["loads"] is False
    runner.close()
