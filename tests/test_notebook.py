"""The notebook of the loop runs, and each of its results shows numbers and a picture."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parent.parent / "examples" / "loop.ipynb"


@pytest.mark.slow
def test_the_notebook_goes_round_the_loop_with_pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names, shown = {}, []
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        *steps, last = ast.parse("".join(cell["source"])).body
        if not isinstance(last, ast.Expr):
            steps, last = [*steps, last], None
        exec(compile(ast.Module(steps, []), NOTEBOOK.name, "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last.value), NOTEBOOK.name, "eval"), names)
        if hasattr(value, "_repr_html_"):
            shown.append(value._repr_html_())
    kinds = [re.match(r"<b>(\w+)</b>", html)[1] for html in shown]
    assert len(kinds) == 6
    assert [kind for kind, html in zip(kinds, shown, strict=True) if "<img src=" not in html] == []
    assert names["run"].success
    assert "tilt_offset" in [effect["name"] for effect in names["found"].json()["effects"]]
    change = names["before"].compare(names["after"])
    assert change.json()["time_s"]["difference"] < 0.0
