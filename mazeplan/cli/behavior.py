"""`behavior check`, `show`, `list`, `palette`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.arguments import BehaviorModule
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError, TreeError

if TYPE_CHECKING:
    from mazeplan.behavior.leaf import Leaf, Port
    from mazeplan.behavior.tree import BehaviorTree

app = typer.Typer(help="Behaviour trees: check, show, list of leaves, palette for Groot2.", no_args_is_help=True)

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]


class _NoRun:
    """The context of a tree that is only looked at."""

    def clock(self) -> float:
        """No time passes."""
        return 0.0

    def failed(self, failure: Any) -> None:
        """Nothing fails."""


def _load(source: str, modules: list[str] | None) -> BehaviorTree:
    from mazeplan.behavior.ownleaves import registry_with
    from mazeplan.behavior.treefile import load_tree

    return load_tree(source, registry_with(modules or ()), _NoRun())


@app.command("check")
def check(
    files: Annotated[list[str], typer.Argument(help="XML files, or names of packaged trees.")],
    behavior_module: BehaviorModule = None,
    json: JsonOption = False,
) -> None:
    """Read trees and say what is wrong with them, with file and line."""
    found: list[dict[str, Any]] = []
    for source in files:
        try:
            nodes = len(list(_load(source, behavior_module).nodes()))
            found.append({"file": source, "ok": True, "nodes": nodes, "error": None})
        except TreeError as error:
            found.append({"file": source, "ok": False, "nodes": None, "error": str(error)})
    if json:
        print_json(found)
    for one in () if json else found:
        if one["ok"]:
            print(f"{one['file']}: ok, {one['nodes']} nodes")
        else:
            say(f"mazeplan: {one['error']}")
    if not all(one["ok"] for one in found):
        raise SystemExit(2)


@app.command("show")
def show(
    source: Annotated[str, typer.Argument(help="XML file, or name of a packaged tree.")] = "navigate",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Draw it into a PNG, SVG or PDF file.")] = None,
    behavior_module: BehaviorModule = None,
) -> None:
    """Show a tree as text, or draw it."""
    from mazeplan.behavior.drawing import save_tree_drawing, tree_text

    tree = _load(source, behavior_module)
    if output is None:
        print(tree_text(tree))
    else:
        save_tree_drawing(tree, output)
        say(f"wrote {output}")


@app.command("list")
def list_leaves(behavior_module: BehaviorModule = None, json: JsonOption = False) -> None:
    """The leaves that a tree may use, with their ports, the control nodes, and preconditions."""
    from mazeplan.behavior.conditions import DECISIONS
    from mazeplan.behavior.decorators import DECORATORS
    from mazeplan.behavior.leaf import REQUIRED
    from mazeplan.behavior.nodes import CONTROLS
    from mazeplan.behavior.ownleaves import registry_with

    registry = registry_with(behavior_module or ())
    if json:
        leaves = {name: _document(leaf) for name, leaf in sorted(registry.usable(_not_listed).items())}
        controls = [*CONTROLS, *DECORATORS, "SubTree"]
        print_json({"leaves": leaves, "control_nodes": controls, "preconditions": list(DECISIONS)})
        return
    for name, leaf in sorted(registry.usable(_not_listed).items()):
        of = f" (package {registry.owners[name].source})" if name in registry.owners else ""
        print(f"{name}: {(leaf.__doc__ or 'no docstring').strip().splitlines()[0]}{of}")
        for port_name, port in leaf.ports.items():
            default = (
                "needed" if port.default is REQUIRED else "" if port.default is None else f"default {port.default}"
            )
            kind = "output" if port.direction == "out" else port.type.__name__
            print(f"    {port_name} ({', '.join(filter(None, (kind, default)))}): {port.doc}{_allowed(port)}")
    print("control nodes: " + ", ".join((*CONTROLS, *DECORATORS, "SubTree")))
    print(f"preconditions of any node: {', '.join(DECISIONS)}, as _skipIf=\"legs &lt; 2 || word == 'fast'\"")


def _document(leaf: type[Leaf]) -> dict[str, Any]:
    """A leaf and its ports, for programs."""
    from mazeplan.behavior.leaf import REQUIRED

    return {
        "what": (leaf.__doc__ or "").strip().partition("\n")[0],
        "ports": {
            name: {
                "type": port.type.__name__,
                "direction": port.direction,
                "needed": port.default is REQUIRED,
                "default": None if port.default is REQUIRED else port.default,
                "what": port.doc,
                "allowed": None if port.choices is None or isinstance(port.choices, str) else [*port.choices],
                "allowed_of_map": port.choices if isinstance(port.choices, str) else None,
            }
            for name, port in leaf.ports.items()
        },
    }


def _not_listed(problem: str) -> None:
    say(f"mazeplan: not listed: {problem}")


def _allowed(port: Port) -> str:
    """The values to choose from, where a port has such."""
    if port.choices is None:
        return ""
    return "; allowed: " + (
        f"{port.choices} of the map" if isinstance(port.choices, str) else ", ".join(map(str, port.choices))
    )


@app.command("palette")
def palette(
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File; default: stdout.")] = None,
    behavior_module: BehaviorModule = None,
) -> None:
    """The leaves as a TreeNodesModel, for the palette of Groot2."""
    from mazeplan.behavior.ownleaves import registry_with
    from mazeplan.behavior.palette import write_palette

    text = write_palette(registry_with(behavior_module or ()).usable(_not_listed))
    if output is None:
        print(text, end="")
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror}", file=output) from None
    say(f"wrote {output}")
