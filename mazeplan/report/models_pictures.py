"""Pictures of a comparison of models."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.palette import COLOURS
from mazeplan.report.drawing import INK, darker, line, plan_view, points
from mazeplan.report.models import Document, around, best_kind, cells, kinds, known, rings
from mazeplan.report.page import Picture
from mazeplan.report.words import DEG, KINDS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLES = {"rf": "neutral", "p": "ring1", "pi": "ring5", "np": "ring3", "npd": "ring4", "sp": "ring2", "model": "ring2"}
MOST_DRAWN = 2.0  # nRMSE; who is worse leaves the picture
MAPS_SHOWN = 3  # kinds of models beside each other


def models_pictures(document: Document, maze: Maze, main: str = "") -> list[Picture]:
    """Those for which the document has numbers; main: the kind that is looked at, where not the best."""
    main = main or best_kind(document)
    numbers, found = rings(document), []
    width = min(12.0, 1.4 + 2.7 * len(numbers))
    if any(scores.get("curve") for scores in document.values()):
        found.append(
            Picture(
                "learning", "Learning curves", "relative test error against the number of training rows, by ring",
                lambda figure: _learning(figure, document), (width, 3.2),
            )
        )  # fmt: skip
    if any(scores.get("bands") for scores in document.values()):
        found.append(
            Picture(
                "rollouts", "How far roll-outs are off: mean, and from 10 to 90 % of the windows",
                "absolute error of the angle against the number of samples rolled out, by ring",
                lambda figure: _rollouts(figure, document), (width, 3.2),
            )
        )  # fmt: skip
    told = [ring for ring in numbers if document[f"ring{ring}"].get("residual")]
    if told:
        shown = _shown(document, main)
        found.append(
            Picture(
                "residual-maze", "What is left of the acceleration, over the maze (white: too few samples)",
                "root mean square residual by ring and angle, over the plan of the maze",
                lambda figure: _over_maze(figure, document, maze, told, shown), (1.0 + 3.7 * len(shown), 4.4),
            )
        )  # fmt: skip
        found.append(
            Picture(
                "residual-rings", f"What is left on average in each ring, by angle and speed: {KINDS.get(main, main)}",
                "heat map of the mean residual against angle and rate, a panel a ring",
                lambda figure: _heat(figure, document, told, main), (9.0, 1.0 + 1.75 * len(told)),
            )
        )  # fmt: skip
    return found


def _shown(document: Document, main: str) -> list[str]:
    """Kinds whose residuals are shown: the equation, its terms with weights, and the best."""
    have = list(next(s["residual"]["rms"] for s in document.values() if s.get("residual")))
    wanted = ["p", "pi", main, "np"]
    return list(dict.fromkeys(kind for kind in wanted if kind in have))[:MAPS_SHOWN] or have[:MAPS_SHOWN]


def _style(kind: str, **more: Any) -> dict[str, Any]:
    name = STYLES.get(kind, "neutral")
    marker = {k: v for k, v in points(name).items() if k not in ("linestyle", "color")}
    return {**line(name), **marker, **more}


def _learning(figure: Figure, document: Document) -> None:
    numbers = rings(document)
    panels = figure.subplots(1, len(numbers), sharey=True, squeeze=False)[0]
    top = 0.1
    for axes, ring in zip(panels, numbers, strict=True):
        scores = document[f"ring{ring}"]
        rows: set[float] = set()
        for kind in kinds(document, "curve"):
            at = [(n, known(y)) for n, y in scores.get("curve", {}).get(kind, [])]
            at.append((scores.get("n_train", math.nan), known(scores["nrmse_test"].get(kind))))
            n, y = zip(*at, strict=True)
            rows |= {value for value in n if value and math.isfinite(value)}
            top = max([top, *(value for value in y if value < MOST_DRAWN)])
            axes.plot(n, y, **_style(kind, markersize=4.5), label=KINDS.get(kind, kind))
        axes.set_xscale("log")
        ticks = sorted(rows)
        axes.set_xticks(ticks, [f"{n:g}" for n in ticks], rotation=45)
        axes.minorticks_off()
        axes.set_title(f"ring {ring}")
        axes.set_xlabel("training rows")
        axes.grid()
    panels[0].set_ylim(0.0, 1.05 * top)
    panels[0].set_ylabel("relative error of the angular\nacceleration on test rows (nRMSE)")
    panels[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _rollouts(figure: Figure, document: Document) -> None:
    numbers = [ring for ring in rings(document) if document[f"ring{ring}"].get("bands")]
    panels = figure.subplots(1, len(numbers), sharey=True, squeeze=False)[0]
    top = 0.0
    for axes, ring in zip(panels, numbers, strict=True):
        for kind in kinds(document, "bands"):
            band = document[f"ring{ring}"]["bands"].get(kind)
            if band is None:
                continue
            mean, low, high = (DEG * np.array([known(v) for v in band[name]]) for name in ("mean", "p10", "p90"))
            k = np.arange(len(mean))
            name = STYLES.get(kind, "neutral")
            axes.plot(k, mean, **line(name), label=KINDS.get(kind, kind))
            axes.plot(k[10::10], mean[10::10], **points(name))
            if kind != "npd":  # it leaves the picture
                axes.fill_between(k, low, high, color=COLOURS[name], alpha=0.16, lw=0)
                top = max(top, float(np.nanmax(high)))
        axes.set_title(f"ring {ring}")
        axes.set_xlabel("samples rolled out")
        axes.grid()
    panels[0].set_ylabel("error of the angle, deg")
    panels[0].set_ylim(0.0, 1.05 * top if top > 0.0 else None)
    _mark_leaving(panels, 1.05 * top)
    panels[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _mark_leaving(panels: Any, top: float) -> None:
    """An arrow at the upper edge where a line goes beyond it."""
    for axes in panels:
        for drawn in list(axes.lines):
            x, y = (np.asarray(values, dtype=float) for values in drawn.get_data())
            above = np.flatnonzero(y > top)
            if drawn.get_linestyle() != "None" and top > 0.0 and len(above):
                axes.plot(x[above[0]], 0.98 * top, marker="^", color=drawn.get_color(), ms=6, clip_on=False, ls="none")


def _over_maze(figure: Figure, document: Document, maze: Maze, told: list[int], shown: list[str]) -> None:
    """One ring of cells in each channel."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Wedge

    panels: Any = figure.subplots(1, len(shown), squeeze=False)[0]
    values = {(kind, ring): around(document[f"ring{ring}"]["residual"], kind) for kind in shown for ring in told}
    top = float(np.nanpercentile(np.concatenate(list(values.values())), 98.0))
    drawn = None
    for axes, kind in zip(panels, shown, strict=True):
        plan_view(axes, maze, np.empty((0, 2)), labels=False)
        for ring in told:
            channel, left = maze.ring(ring), values[kind, ring]
            step = 360.0 / len(left)
            cells_here = [
                Wedge((0, 0), 1e3 * channel.outer_radius, j * step, (j + 1) * step,
                      width=1e3 * (channel.outer_radius - channel.inner_radius))
                for j in range(len(left))
            ]  # fmt: skip
            drawn = PatchCollection(cells_here, cmap=darker("inferno_r", 0.06, 1.0), linewidths=0, zorder=1.5)
            drawn.set_array(np.ma.masked_invalid(left))
            drawn.set_clim(0.0, top)
            axes.add_collection(drawn)
        axes.set_title(KINDS.get(kind, kind))
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=list(panels), shrink=0.75, extend="max", aspect=30)
        bar.set_label("measured less predicted,\nroot mean square, rad/s²")


def _heat(figure: Figure, document: Document, told: list[int], kind: str) -> None:
    panels = figure.subplots(len(told), 1, sharex=True, squeeze=False)[:, 0]
    tables = {ring: document[f"ring{ring}"]["residual"] for ring in told}
    kind = kind if all(kind in t["mean"] for t in tables.values()) else next(iter(tables[told[0]]["mean"]))
    mean = {ring: cells(t["mean"][kind]) for ring, t in tables.items()}
    top = max(float(np.nanpercentile(np.abs(np.concatenate([m.ravel() for m in mean.values()])), 97.0)), 1e-6)
    drawn: Any = None
    for axes, ring in zip(panels, told, strict=True):
        rate = [known(v) for v in tables[ring]["rate"]]
        angle, row = np.linspace(0.0, 360.0, mean[ring].shape[1] + 1), np.arange(len(rate))
        drawn = axes.pcolormesh(angle, row, np.ma.masked_invalid(mean[ring]), cmap="PuOr_r", vmin=-top, vmax=top)
        axes.patch.set(facecolor="white", edgecolor="#c4c4c4", hatch="//////")
        # grey printing shows how large, not which way
        for j, i in zip(*np.nonzero(np.abs(mean[ring]) > 0.35 * top), strict=True):
            value = mean[ring][j, i]
            ink = "white" if abs(value) > 0.65 * top else INK
            axes.text(0.5 * (angle[i] + angle[i + 1]), j + 0.5, "+" if value > 0 else "−", color=ink, ha="center",
                      va="center", fontsize=7)  # fmt: skip
        axes.axhline(0.5 * row[-1], color=INK, lw=0.6)
        axes.set_ylabel(f"ring {ring}\nspeed, rad/s")
        axes.set_yticks(row, [f"{v:.1f}" for v in rate], fontsize=7.5)
    panels[-1].set_xticks(range(0, 361, 45))
    panels[-1].set_xlabel("angle of the ball, deg   (speed: angular; hatched: too few samples)")
    bar = figure.colorbar(drawn, ax=list(panels), extend="both", aspect=40)
    bar.set_label("measured less predicted, mean, rad/s²")
