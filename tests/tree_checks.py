"""What checks of trees are tried with: a file, and what is found in it."""

from __future__ import annotations

from mazeplan.behavior.registry import registry_with
from mazeplan.behavior.trees import check_file

HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main">\n'


class Still:
    def clock(self):
        return 0.0

    def failed(self, failure):
        pass


def found_in(*lines, module=()):
    """What is found in a file whose second line is the first of these."""
    return check_file(HEAD + "\n".join(lines) + "\n</root>", registry_with(module), Still())


def main(content):
    return f'<BehaviorTree ID="Main">{content}</BehaviorTree>'


def lines_of(found):
    return [(e.line, e.problem.partition(" ")[0]) for e in found]
