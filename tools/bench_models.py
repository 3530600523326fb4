"""Section `models`: the tables of `compare` on measured and simulated data, and the map learned from a log."""

from __future__ import annotations

import math
from typing import Any

from bench_kit import BUILD, ROOT, Section, Table, data_folder, execute, mazeplan

from mazeplan.core.maths.angles import difference
from mazeplan.maze.mapfile import load_map

# test nRMSE of rings 1 to 4 in Romeres et al. 2019, on another split and with late rates
PAPER = {
    "rf": "0.49 0.59 0.53 0.67",
    "pi": "0.48 0.63 0.65 0.81",
    "np": "0.38 0.45 0.42 0.71",
    "sp": "0.35 0.43 0.40 0.65",
}


def compared(name: str, scores: dict[str, Any]) -> tuple[Table, Table]:
    """The two tables of one `compare`: accelerations, and roll-outs."""
    first = next(iter(scores.values()))
    kinds, rolled = list(first["nrmse_test"]), list(first["rollout"])
    caption = f"{name}: nRMSE of theta_dd, train / test"
    errors = Table(("ring", "rows, train / test", *kinds, "95 % of sp's test"), caption=caption)
    caption = f"{name}: theta error after 20 / 40 samples, rad"
    ahead = Table(("ring", "windows", *rolled, "95 % of sp's after 40"), caption=caption)
    for ring, s in scores.items():
        cells = [f"{s['nrmse_train'][kind]:.2f} / {s['nrmse_test'][kind]:.3f}" for kind in kinds]
        low, high = s["interval95"]["nrmse_test"]["sp"]
        errors.add(ring, f"{s['n_train']} / {s['n_test']}", *cells, f"{low:.3f} to {high:.3f}")
        cells = [f"{s['rollout'][kind]['20']:.3f} / {s['rollout'][kind]['40']:.3f}" for kind in rolled]
        low, high = s["interval95"]["40"]["sp"]
        ahead.add(ring, f"{s['windows']}, {s['windows_chosen']}", *cells, f"{low:.3f} to {high:.3f}")
    return errors, ahead


def learned_map(log: str, quick: bool) -> Table:
    """Runs with the map that was learned from a log, beside runs with the true map."""
    learned, rig = BUILD / "learned.yaml", BUILD / "toy_with_its_own_map.yaml"
    mazeplan("map", "learn", log, "-o", str(learned), "--force")
    toy = (ROOT / "mazeplan" / "rigs" / "toy.yaml").read_text()
    rig.write_text(toy + f"map: {ROOT / 'maps' / 'cme.yaml'}\n")
    true, found, errors = load_map("cme"), load_map(learned), []
    for opening in found.openings:
        same_wall = [o for o in true.openings if (o.outer, o.inner) == (opening.outer, opening.inner)]
        off = (abs(math.degrees(difference(opening.angle, o.angle))) for o in same_wall)
        errors.append(min(off, default=math.inf))
    table = Table(("planner's map", "openings", "largest error, deg", "arrived", "mean s", "worst s"))
    words = ("evaluate", "--runs", "4" if quick else "16", "--rig")
    plain, other = mazeplan(*words, "toy"), mazeplan(*words, str(rig), "--model", "toy", "--map", str(learned))
    rows = ("true map", len(true.openings), 0.0, plain), ("map learned from the log", len(errors), max(errors), other)
    for name, count, error, e in rows:
        mean, worst = (f"{e['time_s'][key]:.2f}" for key in ("mean", "worst"))
        table.add(name, count, f"{error:.2f}", f"{e['success']}/{e['runs']}", mean, worst)
    return table


def models_section(quick: bool) -> Section:
    """Measured data, simulated data, and the learned map."""
    tables: list[Table] = []
    folder = data_folder("cme-rig")
    if folder is not None:
        tables += compared("measured", mazeplan("compare", *(str(folder / f"ring{n}.csv") for n in (1, 2, 3, 4))))
    log, seconds = str(BUILD / "toy.mcap"), "200" if quick else "1500"
    BUILD.mkdir(exist_ok=True)
    execute("collect", "--rig", "toy", "--rings", "--seconds", seconds, "--seed", "7", "-o", log, "--force")
    tables += compared("simulated", mazeplan("compare", log))
    tables.append(learned_map(log, quick))
    notes = (
        "Measured: `mazeplan compare ring1.csv ring2.csv ring3.csv ring4.csv`, data of the published rig.",
        "Kernel, inputs and delay of the rate were chosen on these data, so these figures are somewhat optimistic.",
        f"Simulated: `mazeplan collect --rig toy --rings --seconds {seconds} --seed 7 -o toy.mcap`, then `compare`.",
        "Every fourth block of 5 s is test; 8 rows on either side of a border are neither.",
        f"Published nRMSE, rings 1 to 4: {'; '.join(f'{kind} {numbers}' for kind, numbers in PAPER.items())}.",
    )
    return Section("Models on measured and simulated data", notes, tables)
