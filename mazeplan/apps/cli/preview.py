"""Preview of the next run of a page, before Start: the place of the ball and the route."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from mazeplan.maze.drawing import route_points
from mazeplan.maze.graph import RouteGraph
from mazeplan.run.request import NavigationRequest


def preview(
    request: NavigationRequest, number: int = 0, goal: int | None = None, closed: Collection[str] = ()
) -> dict[str, Any]:
    """The preview of a run of a page, for `view.livetab.PLANNED`.

    number: of the run, from 0
    goal: a ring that replaces the goal of the request and the rings on the way
    closed: the closed openings

    The route is the route of shortest expected time without a model. Keys of the result:
    start, goal: rings
    ball: x, y, m
    points: of the route on the tracks, (N, 2), m; empty without a route"""
    maze, job = request.maze, request.job
    start, seed = job.start, job.seed + number
    theta = job.start_angle(maze, np.random.default_rng(seed))
    rings = [goal] if goal is not None else [*job.via, job.goal]
    radius = maze.track_radius(start)
    points = [[radius * math.cos(theta), radius * math.sin(theta)]]
    graph = RouteGraph(maze)
    for name in graph.closed - set(closed):
        graph.reopen(name)
    for name in closed:
        graph.close(name)
    document = {"start": start, "goal": rings[-1], "ball": points[0], "points": points}
    ring, at = start, theta
    for towards in rings:
        route = graph.route(ring, towards, at)
        if route is None:
            return {**document, "points": []}
        points += route_points(maze, route).tolist()
        ring, at = towards, route.legs[-1].opening.angle if route.legs else at
    return document
