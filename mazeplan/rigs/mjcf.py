"""The MuJoCo model (MJCF) of a maze on its gimbal, generated from the map and the settings.

The plate is a real two-hinge gimbal, pitch beta about y outside and roll gamma about x inside, R = Ry(beta)
Rx(gamma), driven by position
actuators. The floor is a box (a plane must not move). MuJoCo has no arcs: a wall is a row of boxes that touch at their
edges, and each side of an opening is a box of its own, parallel to the opening's middle line, so that its width is
exactly the map's.
The ball's own friction is 0, because MuJoCo takes the larger of two: floor and walls set it. A table that is not
level is a
gravity that is not vertical.
"""

from __future__ import annotations

import math

from mazeplan.maze.geometry import Maze, Opening, Wall
from mazeplan.rigs.settings import SimulatedSettings

GRAVITY = 9.81  # m/s^2
SUBSTEPS = 20  # per sample; at 30 Hz a time step of 1/600 s
ARMATURE = 0.05  # kg m^2 per axis; with less the weight of the ball tilts the plate
CHEEK = 5e-4  # m, half thickness of the box at the side of an opening
PLUG_ON, PLUG_OFF = (
    1,
    2,
)  # collision bits; the ball has 1. With no bit at all MuJoCo would leave a plug out of its search tree
FLOOR = 0.005  # m, half thickness of the floor
TORSIONAL = 2e-5  # m, friction against spinning on a spot
SOLIMP = "0.95 0.99 0.0005 0.5 2"
TIME_CONSTANT = 0.004  # s, of contacts


def mjcf(maze: Maze, settings: SimulatedSettings) -> str:
    """MJCF text. Bodies: plate, ball; joints: beta, gamma; actuators in that order; a plug geom `plug:NAME` per
    opening."""
    wn, zeta = settings.servo_frequency_rad_s, settings.servo_damping
    kp, kv = ARMATURE * wn**2, 2.0 * zeta * wn * ARMATURE
    x, y = math.radians(settings.table_x_deg), math.radians(settings.table_y_deg)
    gravity = f"{GRAVITY * math.sin(y)} {-GRAVITY * math.sin(x) * math.cos(y)} {-GRAVITY * math.cos(x) * math.cos(y)}"
    timestep = 1.0 / (settings.rate_hz * SUBSTEPS)
    half = maze.walls[0].outer_radius + 0.01
    floor = f'friction="{settings.floor_friction} {TORSIONAL} {settings.rolling_friction_m}"'
    geoms = [f'<geom name="floor" type="box" size="{half} {half} {FLOOR}" pos="0 0 {-FLOOR}" {floor}/>']
    for wall in maze.walls:
        geoms += _wall(wall, maze.wall_height, settings)
    geoms += [_plug(maze, opening) for opening in maze.openings]
    radius, mass = maze.ball.radius, maze.ball.mass
    return f"""<mujoco model="{_safe(maze.name)}">
<compiler angle="radian"/>
<option timestep="{timestep}" integrator="implicitfast" solver="Newton" cone="elliptic" impratio="10"
 noslip_iterations="3" gravity="{gravity}"/>
<default><geom condim="6" solref="{TIME_CONSTANT} {settings.contact_damping_ratio}" solimp="{SOLIMP}"/></default>
<worldbody>
<body name="gimbal"><inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
<joint name="beta" type="hinge" axis="0 1 0" armature="{ARMATURE}"/>
<body name="plate"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 2e-3"/>
<joint name="gamma" type="hinge" axis="1 0 0" armature="{ARMATURE}"/>
{chr(10).join(geoms)}
</body></body>
<body name="ball"><freejoint name="ball"/>
<geom name="ball" type="sphere" size="{radius}" mass="{mass}" friction="0 0 0"/></body>
</worldbody>
<actuator><position joint="beta" kp="{kp}" kv="{kv}"/><position joint="gamma" kp="{kp}" kv="{kv}"/></actuator>
</mujoco>"""


def _safe(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_ " else "_" for c in name)


def _box(x: float, y: float, angle: float, along: float, across: float, height: float, more: str) -> str:
    """A standing box, turned by `angle`: half sizes along and across that direction."""
    return (
        f'<geom type="box" size="{along:.8g} {across:.8g} {0.5 * height:.8g}" pos="{x:.8g} {y:.8g} {0.5 * height:.8g}" '
        f'euler="0 0 {angle:.8g}" {more}/>'
    )


def _wall(wall: Wall, height: float, settings: SimulatedSettings) -> list[str]:
    """Boxes of one wall: rows between openings, and the sides of the openings."""
    friction = f'friction="{settings.wall_grip} {TORSIONAL} {TORSIONAL}"'
    openings = sorted(wall.openings, key=lambda o: o.angle % math.tau)
    if not openings:
        return _row(wall, 0.0, math.tau, height, settings.wall_segments, friction)
    geoms: list[str] = []
    middle = 0.5 * (wall.inner_radius + wall.outer_radius)
    for i, opening in enumerate(openings):
        following = openings[(i + 1) % len(openings)]
        start = opening.angle % math.tau + math.asin((0.5 * opening.width + CHEEK) / middle)
        end = following.angle % math.tau - math.asin((0.5 * following.width + CHEEK) / middle)
        if end <= start:
            end += math.tau
        geoms += _row(wall, start, end, height, settings.wall_segments, friction)
        geoms += _cheeks(wall, opening, height, friction)
    return geoms


def _row(wall: Wall, start: float, end: float, height: float, segments: int, friction: str) -> list[str]:
    """Boxes from angle start to end; their faces touch the wall's circles in the middle."""
    n = max(1, math.ceil((end - start) / math.tau * segments))
    width = (end - start) / n
    half_along = 0.5 * (wall.outer_radius - wall.inner_radius)
    half_across = wall.outer_radius * math.tan(0.5 * width)
    middle = 0.5 * (wall.inner_radius + wall.outer_radius)
    angles = [start + (i + 0.5) * width for i in range(n)]
    return [
        _box(middle * math.cos(a), middle * math.sin(a), a, half_along, half_across, height, friction) for a in angles
    ]


def _cheeks(wall: Wall, opening: Opening, height: float, friction: str) -> list[str]:
    """The two flat sides of an opening, parallel to its middle line, exactly its width apart."""
    half = 0.5 * opening.width
    near, far = (math.sqrt(radius**2 - half**2) for radius in (wall.inner_radius, wall.outer_radius))
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    along, boxes = 0.5 * (near + far), []
    for side in (-1.0, 1.0):
        across = side * (half + CHEEK)
        x, y = c * along - s * across, s * along + c * across
        boxes.append(_box(x, y, opening.angle, 0.5 * (far - near), CHEEK, height, friction))
    return boxes


def _plug(maze: Maze, opening: Opening) -> str:
    """A box that fills an opening; it touches nothing until a fault switches it on."""
    near, far = maze.ring(opening.inner).outer_radius, maze.ring(opening.outer).inner_radius
    along = 0.5 * (near + far)
    x, y = along * math.cos(opening.angle), along * math.sin(opening.angle)
    more = f'name="plug:{_safe(opening.name)}" contype="{PLUG_OFF}" conaffinity="{PLUG_OFF}" rgba="1 0 0 0.2"'
    return _box(x, y, opening.angle, 0.5 * (far - near), 0.5 * opening.width, maze.wall_height, more)


def plug_name(opening: str) -> str:
    """Name of the plug geom of an opening."""
    return f"plug:{_safe(opening)}"
