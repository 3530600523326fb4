"""`behavior check`, `show`, `list` and `palette`."""

from __future__ import annotations

from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_result, say
from mazeplan.core.errors import TreeError
from mazeplan.core.whole_file import write_text

if TYPE_CHECKING:
    from mazeplan.btree.node import TreeNode

app = typer.Typer(help="Check and show behaviour trees; list leaves.", no_args_is_help=True)

Trees = Annotated[list[str], typer.Argument(metavar="TREE", help="XML files, or names of packaged trees.")]
ShownTree = Annotated[
    str | None, typer.Argument(metavar="TREE", help="XML file, or name of a packaged tree. Default: navigate.")
]
Whole = Annotated[bool, typer.Option("--whole", help="Draw a SubTree that stands in the tree again each time.")]
CheckedMap = Annotated[
    str | None, opt.value("--map", "MAP", "Map whose rings and openings the tree may name. Default: any names.")
]
Palette = Annotated[Path | None, opt.output_file("File to write. Default: stdout.", opt.TREE)]
LEAVES = ("Action", "Condition")  # categories of leaves
KINDS = {"leaves": LEAVES, "control nodes": ("Control",), "decorators": ("Decorator",)}


@app.command("check")
def check(
    files: Trees, map_: CheckedMap = None, behavior_module: opt.BehaviorModule = None, as_json: opt.AsJson = False
) -> None:
    """Check trees, and name the file and line of each problem."""
    from mazeplan.behavior.registry import registry_with
    from mazeplan.behavior.trees import StaticContext, check_file
    from mazeplan.btree.check import Findings
    from mazeplan.maze.mapfile import load_map

    context, found = StaticContext(None if map_ is None else load_map(map_)), list[dict[str, Any]]()
    for source in files:
        registry = registry_with(behavior_module or ())
        try:
            result = check_file(source, registry, context)
        except TreeError as error:
            result = Findings((error,))
        errors, warnings = [str(e) for e in result.errors], [str(w) for w in result.warnings]
        found.append({
            "file": source, "ok": not errors, "nodes": result.nodes, "error": errors[0] if errors else None,
            "errors": errors, "warnings": warnings,
        })  # fmt: skip
    for tree in () if as_json else found:
        for line in (*tree["errors"], *(f"warning: {warning}" for warning in tree["warnings"])):
            say(f"mazeplan: {line}")
    print_result(as_json, found, *(f"{tree['file']}: ok, {tree['nodes']} nodes" for tree in found if tree["ok"]))
    if not all(tree["ok"] for tree in found):
        raise SystemExit(2)


@app.command("show")
def show(source: ShownTree = None, whole: Whole = False, behavior_module: opt.BehaviorModule = None) -> None:
    """Draw a tree as text."""
    from mazeplan.behavior.registry import registry_with
    from mazeplan.behavior.trees import StaticContext, load_tree
    from mazeplan.btree.tree import tree_text

    print(tree_text(load_tree(source or "navigate", registry_with(behavior_module or ()), StaticContext()), whole))


@app.command("list")
def list_leaves(behavior_module: opt.BehaviorModule = None, as_json: opt.AsJson = False) -> None:
    """List all nodes that a tree may name, with their ports, and the conditions that any node may have."""
    from mazeplan.behavior.registry import registry_with
    from mazeplan.btree.builder import BUILTIN
    from mazeplan.btree.node import CONDITIONS, DECISIONS

    registry = registry_with(behavior_module or ())
    nodes = {name: _document(node) for name, node in {**dict(sorted(registry.items())), **BUILTIN}.items()}
    leaves = {name: node for name, node in nodes.items() if name not in BUILTIN and node["category"] in LEAVES}
    after = [name for name in CONDITIONS if name not in DECISIONS]
    document = {
        "leaves": leaves, "nodes": {name: node for name, node in nodes.items() if name not in leaves},
        "control_nodes": [*(name for name, node in nodes.items() if node["category"] not in LEAVES), "SubTree"],
        "preconditions": list(DECISIONS), "postconditions": after, "enums": dict(registry.enums),
    }  # fmt: skip
    lines = list[str]()
    for kind, categories in KINDS.items():
        lines.append(f"{kind}:")
        for name, node in nodes.items():
            lines += _lines(name, node) if node["category"] in categories else []
    lines += [
        "SubTree: the tree of that ID; attributes are keys of its blackboard",
        f"preconditions of any node: {', '.join(DECISIONS)}, as _skipIf=\"legs &lt; 2 || word == 'fast'\"",
        f'postconditions of any node: {", ".join(after)}, as _onSuccess="legs += 1"',
    ]
    if registry.enums:
        lines.append("names that scripts know: " + ", ".join(f"{name} = {n}" for name, n in registry.enums.items()))
    print_result(as_json, document, *lines)


def _document(node: type[TreeNode]) -> dict[str, Any]:
    """A node and its ports, for programs."""
    from mazeplan.btree.ports import REQUIRED

    ports = {
        name: {
            "type": port.type.__name__, "direction": port.direction, "needed": port.default is REQUIRED,
            "default": None if port.default is REQUIRED else port.default, "what": port.doc,
            "allowed": None if port.choices is None or isinstance(port.choices, str) else [*port.choices],
            "allowed_of_map": port.choices if isinstance(port.choices, str) else None,
        }
        for name, port in node.ports.items()
    }  # fmt: skip
    purpose = " ".join(cleandoc(node.__doc__ or "").partition("\n\n")[0].split())
    return {"what": purpose, "category": node.category, "ports": ports}


def _lines(name: str, node: dict[str, Any]) -> list[str]:
    """A node and its ports, a line each."""
    lines = [f"{name}: {node['what'] or 'no docstring'}"]
    for port_name, port in node["ports"].items():
        kind = "output" if port["direction"] == "out" else port["type"]
        default = ", needed" if port["needed"] else "" if port["default"] is None else f", default {port['default']}"
        allowed = f"{port['allowed_of_map']} of the map" if port["allowed_of_map"] else ""
        allowed = allowed or ", ".join(map(str, port["allowed"] or ()))
        lines.append(f"    {port_name} ({kind}{default}): {port['what']}{f'; allowed: {allowed}' if allowed else ''}")
    return lines


@app.command("palette")
def palette(output: Palette = None, behavior_module: opt.BehaviorModule = None, force: opt.Force = False) -> None:
    """Write the leaves as a TreeNodesModel, for the palette of Groot2."""
    from mazeplan.behavior.registry import registry_with
    from mazeplan.btree.treefile import write_palette

    text = write_palette(registry_with(behavior_module or ()))
    if output is None:
        print(text, end="")
    else:
        write_text(output, text)
        say(f"wrote {output}")
