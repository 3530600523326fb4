"""A Hypothesis strategy: ball behaviours that a map allows.

This is the only module that imports hypothesis, which comes with the extra `testing`.
"""

from __future__ import annotations

import math
from pathlib import Path

from mazeplan.apps.testing.balls import BallBehaviour, Jump, Move, Pass, Rest, Roll
from mazeplan.core.resources import to_install
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map

try:
    from hypothesis import strategies as st
except ModuleNotFoundError:
    raise ImportError(
        f"the strategies of mazeplan.apps.testing need hypothesis, which is not installed: {to_install('testing')}"
    ) from None


FASTEST_DEG_S = 200.0  # along a ring: 0.3 m/s in the outermost one


def _maze(maze: Maze | str | Path) -> Maze:
    return maze if isinstance(maze, Maze) else load_map(maze)


def _tenths(least: float, most: float) -> st.SearchStrategy[float]:
    """Multiples of 0.1: they read well, and hypothesis shrinks them to small ones."""
    return st.integers(round(10 * least), round(10 * most)).map(lambda n: n / 10)


def ball_behaviours(
    maze: Maze | str | Path = "cme", *, most_moves: int = 6, jumps: bool = True
) -> st.SearchStrategy[BallBehaviour]:
    """Ball behaviours that the map allows: the ball rolls along rings, rests, passes openings of its ring inwards or
    outwards, jumps to another ring, and is not seen at times.

    maze: a Maze, or name or file of a map
    most_moves: maximum number of moves
    jumps: whether the ball may jump to another ring"""
    return _ball_behaviours(_maze(maze), most_moves, jumps)


@st.composite
def _ball_behaviours(draw: st.DrawFn, maze: Maze, most_moves: int, jumps: bool) -> BallBehaviour:
    ring = start = draw(st.integers(1, len(maze.rings)))
    theta = draw(st.integers(-180, 180))
    moves: list[Move] = []
    for _ in range(draw(st.integers(0, most_moves))):
        kinds = ["roll", "rest", "pass"] if maze.openings_of(ring) else ["roll", "rest"]
        match draw(st.sampled_from(kinds + ["jump"] * jumps)):
            case "roll":
                turn = draw(st.integers(-90, 90))
                moves.append(
                    Roll(draw(_tenths(max(0.1, math.ceil(abs(turn) / FASTEST_DEG_S * 10) / 10), 2.0)), float(turn))
                )
            case "rest":
                moves.append(Rest(draw(_tenths(0.1, 2.0))))
            case "pass":
                opening = draw(st.sampled_from(maze.openings_of(ring)))
                moves.append(Pass(opening.name, draw(_tenths(0.1, 0.4))))
                ring = opening.leads_to(ring)
            case _:
                ring = draw(st.integers(1, len(maze.rings)))
                moves.append(Jump(ring, float(draw(st.integers(-180, 180)))))
    unseen = draw(st.lists(st.tuples(_tenths(0.0, 5.0), _tenths(0.1, 1.5)), max_size=2))
    return BallBehaviour(start, float(theta), tuple(moves), tuple((a, round(a + b, 1)) for a, b in unseen))
