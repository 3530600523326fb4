"""An outside package with a rig, an effect and a leaf: installed, and used from the command line; and broken ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import call
from pages import ROOT
from plant import play
from ring_record import write_csv

from mazeplan.core import plugins
from mazeplan.core.errors import InputError
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.logs.table import Table

OUTSIDE = Path(__file__).resolve().parents[1] / "outside"
HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">\n'
TAIL = "\n</BehaviorTree></root>"
KNOWN = ("--radius", "0.0925", "--declare", "rolling_inertia.factor=0.7142857", "--declare",
         "viscous_friction.coefficient=0.35")  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Where the outside package was installed, by pip."""
    target = tmp_path_factory.mktemp("site")
    words = "--no-deps --no-build-isolation --no-index --quiet --disable-pip-version-check --no-compile"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *words.split(), "--target", str(target), str(OUTSIDE)],
        check=True, capture_output=True,
    )  # fmt: skip
    return target


@pytest.fixture
def mazeplan(site, tmp_path):
    """The program in a process of its own that sees the package, in an empty folder."""
    path = os.pathsep.join([str(ROOT), str(site)])

    def run(*words):
        done = subprocess.run(
            [sys.executable, "-m", "mazeplan", *map(str, words)], cwd=tmp_path, capture_output=True, text=True,
            check=False, env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip
        assert "Traceback" not in done.stderr, done.stderr
        return done

    return run


@pytest.fixture
def seen(site, tmp_path, monkeypatch):
    """The package is seen by this process, too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(site))
    plugins.plugins.cache_clear()
    yield
    plugins.plugins.cache_clear()


@pytest.mark.slow
def test_what_was_installed_is_listed_with_where_it_is_from(mazeplan, seen, monkeypatch, capsys):
    document = json.loads(mazeplan("rig", "list", "--json").stdout)
    assert document["rigs"][-2:] == ["cart", "slow-cart"]
    assert document["installed"]["cart"] == {
        "package": "outside-cart", "version": "1.2", "object": "outside_cart:Cart"
    }  # fmt: skip
    leaves = call(monkeypatch, capsys, "behavior", "list")[1]
    assert "Nap: Leave the plate level for some ticks. (package outside-cart 1.2)\n    ticks (int, default 3)" in leaves
    assert '<Action ID="Nap">' in call(monkeypatch, capsys, "behavior", "palette")[1]


@pytest.mark.slow
def test_a_run_on_its_rig_with_its_leaf_and_the_same_in_workers(mazeplan, seen, monkeypatch, capsys, tmp_path):
    text = (ROOT / "behaviors" / "navigate.xml").read_text()
    nap = '<Nap ticks="4" _skipIf="goal == 1"/> <SubTree ID="Travel"'
    (tmp_path / "nap.xml").write_text(text.replace('<SubTree ID="Travel"', nap))
    words = ("--from", "ring4", "--to", "ring5", "--behavior", "nap.xml", "--json")
    code, out, err = call(monkeypatch, capsys, "navigate", *words, "--rig", "cart", "--log", "run.mcap")
    assert code == 0, err
    document = json.loads(out)
    assert (document["success"], document["rig"]) == (True, "cart")
    replayed = call(monkeypatch, capsys, "log", "replay", "run.mcap")
    assert replayed[0] == 0, replayed
    assert list(read_log(tmp_path / "run.mcap").header["replay"]["leaves"]) == ["Nap"]
    # the rig whose file names a model of its own
    campaign = mazeplan("evaluate", *words, "--rig", "slow-cart", "--runs", "2", "--workers", "2")
    assert campaign.returncode == 0, campaign.stderr
    assert campaign.stderr == ""
    document = json.loads(campaign.stdout)
    assert (document["success"], document["setup"]["rig"]) == (2, "slow-cart")


def test_a_log_is_not_replayed_with_another_leaf(offer, monkeypatch, capsys, tmp_path):
    offer(code=LEAF.format(STEP), leaves=["Doze = bad_module:Doze"])
    (tmp_path / "tree.xml").write_text(f"{HEAD}<Doze/>{TAIL}")
    call(monkeypatch, capsys, "navigate", "--rig", "ideal", "--behavior", "tree.xml", "--log", "run.mcap")
    assert call(monkeypatch, capsys, "log", "replay", "run.mcap")[0] == 0
    file = tmp_path / "site" / "bad_module.py"
    file.write_text(file.read_text() + "\n")
    got = call(monkeypatch, capsys, "log", "replay", "run.mcap")
    one_line(got, f"the leaf Doze ({file}) is not that of the run")


@pytest.mark.slow
def test_its_effect_is_found_by_a_diagnosis_and_can_be_declared(mazeplan, seen, monkeypatch, capsys, tmp_path):
    write_csv(Table(play(seed=3, seconds=15.0, wave=(0.0, -0.5, 0.0, 0.0))), tmp_path / "log.csv")
    found = json.loads(call(monkeypatch, capsys, "diagnose", "log.csv", *KNOWN, "--json")[1])
    assert [e["name"] for e in found["effects"]] == ["wind"]
    assert found["effects"][0]["parameters"]["force"]["value"] == pytest.approx(0.5, abs=0.05)
    assert "also tried wind of package outside-cart 1.2" in found["notes"]
    declared = mazeplan("diagnose", "log.csv", *KNOWN, "--declare", "wind.force=9", "--json")
    assert (declared.returncode, declared.stderr) == (
        2,
        "mazeplan: --declare: got wind.force 9, expected -5 to 5 rad/s^2\n",
    )


# -- in this process -------------------------------------------------------------------------------------------------


@pytest.fixture
def offer(tmp_path, monkeypatch):
    """Have a package of that name installed, with these entry points, which nobody has built."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    plugins.plugins.cache_clear()
    before = set(sys.modules)

    def write(package="bad", code="", **groups):
        info = tmp_path / "site" / f"{package}-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        rows = [f"[mazeplan.{group}]\n" + "\n".join(lines) for group, lines in groups.items()]
        (info / "entry_points.txt").write_text("\n".join(rows))
        (tmp_path / "site" / f"{package}_module.py").write_text(code)
        plugins.plugins.cache_clear()

    yield write
    plugins.plugins.cache_clear()
    for name in set(sys.modules) - before:
        if name.endswith("_module"):
            del sys.modules[name]


def one_line(got, *words):
    code, out, err = got
    assert (code, out) == (2, "")
    for word in words:
        assert word in err, err
    said = [line for line in err.strip().splitlines() if not line.startswith("compiling, once for this machine")]
    assert len(said) == 1, said


RIG = "package bad 1.0, entry point mazeplan.rigs: broken = "


@pytest.mark.parametrize(
    ("value", "code", "said"),
    [
        ("gone_module:Rig", "", "cannot be imported: ModuleNotFoundError: No module named 'gone_module'"),
        ("bad_module:Rig", "", "cannot be imported: AttributeError: module 'bad_module' has no attribute 'Rig'"),
        ("bad_module:Rig", "\n1 / 0", "bad_module.py:2: ZeroDivisionError: division by zero"),
        ("bad_module:Rig", "import sys\nsys.exit('off')", "bad_module.py:2: SystemExit: off"),
        ("bad_module:Rig", "Rig = 3", "is no rig: it lacks reset, observe, command, level, close"),
        (
            "bad_module:Rig",
            "class Rig:\n    def reset(self): ...",
            "is no rig: it lacks observe, command, level, close",
        ),
        (
            "bad_module:Rig",
            "Rig = 'nowhere.yaml'",
            "got 'nowhere.yaml', expected an existing YAML file, or a class",
        ),
    ],
)
def test_a_broken_rig_is_one_line_when_it_is_used_and_nothing_else_minds(offer, monkeypatch, capsys, value, code, said):
    offer(code=code, rigs=[f"broken = {value}", "toy = bad_module:Toy"])
    one_line(call(monkeypatch, capsys, "rig", "check", "broken"), RIG + value, said)
    status, out, err = call(monkeypatch, capsys, "rig", "list")
    assert (status, err) == (0, "")
    assert f"of package bad 1.0: broken ({value})\n" in out
    assert "toy (bad_module:Toy): not used: the program has a rig of this name, which comes first" in out
    document = json.loads(call(monkeypatch, capsys, "rig", "list", "--json")[1])
    assert document["rigs"].count("toy") == 1
    assert list(document["installed"]) == ["broken"]


def test_a_name_that_nobody_has_is_told_with_those_of_packages(offer, monkeypatch, capsys):
    offer(rigs=["cart = bad_module:Rig"])
    done = call(monkeypatch, capsys, "navigate", "--rig", "wagon")
    one_line(done, "got rig 'wagon', expected one of ", ", toy, ", ", cart,")
    assert done[0] == 2


def test_one_name_in_two_packages_is_told(offer, monkeypatch, capsys):
    offer(rigs=["broken = bad_module:Rig"])
    offer("worse", rigs=["broken = worse_module:Rig"])
    same = "package worse 1.0 has the same name; uninstall one of them"
    done = call(monkeypatch, capsys, "navigate", "--rig", "broken")
    one_line(done, f"{RIG}bad_module:Rig: {same}")
    assert done[0] == 2


LEAF = "from mazeplan import MazeLeaf, Port, Status\n\n\nclass Doze(MazeLeaf):\n    {}\n"
STEP = "def step(self):\n        return Status.SUCCESS"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("\n1 / 0", "bad_module.py:2: ZeroDivisionError"),
        ("Doze = 3", "got 3, expected a class derived from mazeplan.MazeLeaf that has a step"),
        (LEAF.format("pass"), "expected a class derived from mazeplan.MazeLeaf that has a step"),
        (
            LEAF.format(STEP).replace("Doze", "Dose") + "\nDoze = Dose\n",
            "got the class Dose, expected one whose name is",
        ),
        (LEAF.format('ports = {"a": 3}\n\n    ' + STEP), "ports['a']: got 3, expected a Port"),
    ],
)
def test_a_broken_leaf_is_one_line_at_its_place_in_the_tree(offer, monkeypatch, capsys, tmp_path, code, said):
    offer(code=code, leaves=["Doze = bad_module:Doze", "Track = bad_module:Track", "Sequence = bad_module:X"])
    (tmp_path / "tree.xml").write_text(f"{HEAD}<Doze/>{TAIL}")
    label = "package bad 1.0, entry point mazeplan.leaves: Doze = bad_module:Doze"
    one_line(call(monkeypatch, capsys, "behavior", "check", "tree.xml"), "tree.xml:2: ", label, said)
    one_line(call(monkeypatch, capsys, "navigate", "--rig", "ideal", "--behavior", "tree.xml"), label, said)
    assert call(monkeypatch, capsys, "behavior", "check", "navigate")[::2] == (0, "")
    status, out, err = call(monkeypatch, capsys, "behavior", "list")
    assert status == 0
    assert "Doze:" not in out
    assert err.startswith(f"mazeplan: leaf ignored: {label}")
    assert err.count("\n") == 1  # what the program has itself is not looked at


def test_a_module_of_ones_own_comes_before_an_installed_leaf(offer, monkeypatch, capsys, tmp_path):
    offer(code="1 / 0", leaves=["Doze = bad_module:Doze"])
    (tmp_path / "mine_module.py").write_text(LEAF.format(STEP))
    (tmp_path / "tree.xml").write_text(f"{HEAD}<Doze/>{TAIL}")
    got = call(monkeypatch, capsys, "behavior", "check", "tree.xml", "--behavior-module", "mine_module")
    assert got == (0, "tree.xml: ok, 1 nodes\n", "")


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("\n1 / 0", "bad_module.py:2: ZeroDivisionError"),
        ("gust = 3", "gives no effects: got 3, expected an Effect, several, or a function"),
        ("def gust():\n    return [3]", "got 3, expected an Effect with a formula that acts on the ball"),
        (
            "from mazeplan.physics.effects.ball import quadratic_drag as gust",
            "got the name 'quadratic_drag', which the library has; expected another",
        ),
        (
            "from mazeplan.physics import Effect, Parameter\n\n"
            "gust = Effect('gust', {'c': Parameter('', 0.0, -1.0, 1.0)}, formula=lambda s: s.theta_dot)",
            "the formula of gust cannot be compiled: ",
        ),
    ],
)
def test_a_broken_effect_is_told_and_looked_for_no_further_and_no_use_when_declared(
    offer, monkeypatch, capsys, tmp_path, code, said
):
    offer(code=code, effects=["gust = bad_module:gust"])
    write_csv(Table(play(seed=3, seconds=15.0)), tmp_path / "log.csv")
    label = "package bad 1.0, entry point mazeplan.effects: gust = bad_module:gust"
    words = ("diagnose", "log.csv", "--radius", "0.09")
    one_line(call(monkeypatch, capsys, *words, "--declare", "gust.force=1"), label, said)
    looked_for: list = []

    def looked(*given, more, **others):
        looked_for.extend(more)
        raise InputError("enough")

    monkeypatch.setattr("mazeplan.diagnosis.ring.diagnose.diagnose", looked)
    _, _, err = call(monkeypatch, capsys, *words)
    assert looked_for == []
    told, end = err.splitlines()
    assert told.startswith(f"mazeplan: effect ignored: {label}: ")
    assert said in told
    assert end == "mazeplan: enough"
