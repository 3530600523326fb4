"""Bad input of any command: exit status 2, one line that names the option, the file or the place, and no file."""

from __future__ import annotations

from pathlib import Path

import pytest

TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Nowhere/></BehaviorTree></root>'
FILES = {
    "a.csv": "t,theta,beta,gamma\n0,0,0,0\n",
    "angles.csv": "t,theta,beta,gamma,u_beta,u_gamma\n" + "".join(f"{k / 30},{k / 90},0,0,0,0\n" for k in range(90)),
    "bad.csv": "t,theta\n0,x\n",
    "bad.json": "{",
    "bad.xml": TREE,
    "bad.yaml": "rings: 3\n",
    "notes.mcap": "no log\n",
    "rig.yaml": "camera_noise_mm: -1\n",
}
LINES = {  # a command line -> what the message names
    "navigate --from ring9": "--from",
    "navigate --to ring1 --from ring1 --via 9": "--via",
    "navigate --map bad.yaml": "bad.yaml",
    "navigate --map nowhere": "nowhere",
    "navigate --rig nothing": "--rig",
    "navigate --rig rig.yaml": "rig.yaml:1: camera_noise_mm",
    "navigate --rig no_module:Rig": "no_module",
    "navigate --model nothing": "--model",
    "navigate --behavior bad.xml": "bad.xml:1",
    "navigate --behavior-module no_such_module": "no_such_module",
    "navigate --settings bad.yaml": "bad.yaml",
    "navigate --close 1-2": "--close",
    "navigate --policy nothing": "--policy",
    "navigate --seed -1": "--seed",
    "navigate --time-limit 0": "--time-limit",
    "navigate --start-angle north": "--start-angle",
    "navigate --rig ideal --start-angle 400": "-360 to 360",
    "navigate --balls 3": "--balls",
    "navigate --effects nothing": "--effects",
    "evaluate --runs 0": "--runs",
    "evaluate --faults gate_blocked": "--faults",
    "evaluate -o model": "-o",
    "evaluate --store a.csv --runs 1": "a.csv",
    "collect --seconds 0 -o x.mcap": "--seconds",
    "collect --tilt 9 -o x.mcap": "--tilt",
    "collect --highest-hz 20 -o x.mcap": "--highest-hz",
    "collect --model toy -o x.mcap": "--model",
    "collect -o x.csv": "-o",
    "learn a.csv -o model --device abacus": "--device",
    "learn nothing.mcap -o model": "nothing.mcap",
    "learn bad.csv -o model": "bad.csv",
    "learn a.csv --kind rf -o model": "--kind",
    "compare nothing.mcap": "nothing.mcap",
    "compare a.csv --kinds xy": "--kinds",
    "compare angles.csv --ring 9": "--ring",
    "score toy notes.mcap": "notes.mcap",
    "diagnose nothing.csv": "nothing.csv",
    "diagnose angles.csv --radius 9": "--radius",
    "diagnose angles.csv --radius 0.08 --declare rust.amount=1": "--declare",
    "diagnose angles.csv --radius 0.08 --declare dry_friction.coefficient=x": "--declare",
    "diagnose angles.csv --ring 2 --reference a.csv": "--ring",
    "diagnose angles.csv --system clock": "--system",
    "diagnose angles.csv --system no_module:Clock": "no_module",
    "diagnose angles.csv --system emps --ring 2": "--ring",
    "improve --rig nothing": "--rig",
    "improve --rig ideal --rounds 0": "--rounds",
    "report bad.json -o x.html": "bad.json:1",
    "report a.csv -o x.html": "a.csv",
    "report bad.json -o x.pdf": "-o",
    "view notes.mcap": "notes.mcap",
    "map check nothing.yaml": "nothing.yaml",
    "map route --from ring9": "--from",
    "map route --close nothing": "nothing",
    "map show nowhere": "nowhere",
    "map learn a.csv": "a.csv",
    "log info nothing.mcap": "nothing.mcap",
    "log export notes.mcap -o x.csv": "notes.mcap",
    "log replay a.csv": "a.csv",
    "behavior check bad.xml": "bad.xml:1",
    "behavior show nowhere": "nowhere",
    "rig check nothing": "nothing",
    "rig check plank.py": "module:Class",
    "rig check rig.yaml": "rig.yaml:1",
    "model show nothing": "nothing",
    "effect show rust": "rust",
    "policy train --rig nothing -o policy": "--rig",
    "calibrate tilt --rig bad.yaml": "bad.yaml",
    "calibrate camera --corners 2x2": "--corners",
    "data import-cme nothing -o out": "nothing",
    "new rig 2fast": "NAME",
    "new rig toy": "NAME",
    "new tree nothing -o x.xml": "NAME",
    "nonsense": "nonsense",
    "map nonsense": "nonsense",
}  # fmt: skip


@pytest.mark.parametrize("line", LINES)
def test_bad_input_is_one_line_that_names_its_place(refused, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text)
    assert LINES[line] in refused(*line.split())
    assert {path.name for path in tmp_path.iterdir()} == {*FILES}
