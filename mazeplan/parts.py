"""From maze, model and settings to the parts that a run is made of."""

from __future__ import annotations

from mazeplan.control.cost import CostParameters
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.control.stopwatch import Stopwatch
from mazeplan.control.tilt import Plate
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel
from mazeplan.models.ring_parameters import RingParameters


def plate_of(maze: Maze, model: RigModel) -> Plate:
    """Limits of the maze and the table's tilt by the model."""
    ball = model.ball(1)
    return Plate(
        maze.tilt_limit,
        ball.parameter("tilt_offset", "beta", 0.0),
        ball.parameter("tilt_offset", "gamma", 0.0),
    )


def planners_of(
    maze: Maze, model: RigModel, cost: CostParameters, watch: Stopwatch | None = None
) -> dict[int, RingPlanner]:
    """A planner for each channel; watch: for their deadlines."""
    cost = cost.seen_late(model.late_s)
    return {
        ring.number: RingPlanner(
            RingParameters.from_model(model, ring.number, ring.track_radius),
            maze.tilt_limit,
            cost=cost,
            process=model.processes.get(ring.number),
            watch=watch,
        )
        for ring in maze.rings
        if not ring.is_disc
    }
