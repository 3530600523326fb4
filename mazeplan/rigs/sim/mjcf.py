"""The MuJoCo model (MJCF) of a maze on its gimbal, generated from the map and the settings.

The plate is a real gimbal with two hinges and position actuators. The outer hinge is pitch beta about y, the inner
hinge is roll gamma about x: R = Ry(beta) Rx(gamma). The floor is a box, because a plane in MuJoCo cannot move.

MuJoCo has no arcs, so a wall is a row of boxes that touch at their edges. Beside an opening the boxes are narrower, so
that they do not reach into it. The row ends at a flat box, the cheek. So the opening has the map's width all the way
from the wall's inner circle to its outer circle, without hollows at its sides.

The ball's friction is 0: MuJoCo uses the larger friction of two touching bodies, so floor and walls set it. For a table
that leans, the model's gravity is not vertical.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from mazeplan.core.constants import GRAVITY, SOLID
from mazeplan.core.maths.angles import difference
from mazeplan.maze.geometry import Maze, Opening, RadialWall, Wall
from mazeplan.rigs.sim.settings import SimulatedSettings

SUBSTEPS = 20  # MuJoCo's steps per sample; at 30 Hz a time step of 1/600 s
ARMATURE = 0.05  # kg m^2 per axis; with less inertia the ball's weight would tilt the plate
CHEEK = 1.5e-4  # m, half thickness of a cheek; a thick cheek would stand out of the wall's arc
SHOULDER = 2e-4  # m, arc of each box beside an opening; the cheek covers the gap between these boxes and the opening
# collision bits of a plug; the ball has bit 1. A plug without any bit would not be in MuJoCo's search tree
PLUG_ON, PLUG_OFF = 1, 2
FLOOR_HALF = 0.005  # m, half thickness of the floor
TORSIONAL = 2e-5  # m, friction against a spin of the ball about the normal of a contact
SOLIMP = "0.95 0.99 0.0005 0.5 2"
TIME_CONSTANT = 0.004  # s, time constant of contacts


def mjcf(maze: Maze, settings: SimulatedSettings, *, walls: bool = True) -> str:
    """MJCF text of a maze, with these names:

    bodies: plate, ball, and ball2 if the maze has two balls
    joints: beta, gamma, and one for each ball
    actuators: beta, gamma
    geoms: `plug_name`, the plug of each opening

    walls: False: without walls and plugs."""
    boxes: list[str] = []
    if walls:
        boxes += [box for wall in maze.walls for box in _wall(wall, maze.wall_height, settings)]
        boxes += [_across(maze, wall, settings) for wall in maze.radial_walls]
        boxes += [_plug(maze, opening) for opening in maze.openings]
    wn, zeta = settings.servo_frequency_rad_s, settings.servo_damping
    kp, kv = ARMATURE * wn**2, 2.0 * zeta * wn * ARMATURE
    wn, zeta = settings.servo_gamma_frequency_rad_s or wn, settings.servo_gamma_damping or zeta
    kp2, kv2 = ARMATURE * wn**2, 2.0 * zeta * wn * ARMATURE
    x, y = math.radians(settings.table_x_deg), math.radians(settings.table_y_deg)
    gravity = f"{GRAVITY * math.sin(y)} {-GRAVITY * math.sin(x) * math.cos(y)} {-GRAVITY * math.cos(x) * math.cos(y)}"
    timestep = 1.0 / (settings.rate_hz * SUBSTEPS)
    half = maze.walls[0].outer_radius + 0.01
    floor = f'friction="{settings.floor_friction} {TORSIONAL} {settings.rolling_friction_m}"'
    geoms = [
        f'<geom name="floor" type="box" size="{half} {half} {FLOOR_HALF}" pos="0 0 {-FLOOR_HALF}" {floor}/>',
        *boxes,
    ]
    radius, mass = maze.ball.radius, maze.ball.mass
    inertia = ""  # MuJoCo then computes the inertia of a solid sphere
    if settings.ball_inertia != SOLID:
        about = settings.ball_inertia * mass * radius**2
        inertia = f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{about} {about} {about}"/>'
    balls = [
        f'<body name="{name}">{inertia}<freejoint name="{name}"/>\n'
        f'<geom name="{name}" type="sphere" size="{radius}" mass="{mass}" friction="0 0 0"/></body>'
        for name in ["ball", *(f"ball{number}" for number in range(2, 1 + maze.balls))]
    ]
    return f"""<mujoco>
<compiler angle="radian"/>
<option timestep="{timestep}" integrator="implicitfast" solver="Newton" cone="elliptic" impratio="10"
 noslip_iterations="3" gravity="{gravity}"/>
<default><geom condim="6" solref="{TIME_CONSTANT} 1" solimp="{SOLIMP}"/></default>
<worldbody>
<body name="gimbal"><inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
<joint name="beta" type="hinge" axis="0 1 0" armature="{ARMATURE}"/>
<body name="plate"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 2e-3"/>
<joint name="gamma" type="hinge" axis="1 0 0" armature="{ARMATURE}"/>
{chr(10).join(geoms)}
</body></body>
{chr(10).join(balls)}
</worldbody>
<actuator><position joint="beta" kp="{kp}" kv="{kv}"/><position joint="gamma" kp="{kp2}" kv="{kv2}"/></actuator>
</mujoco>"""


def _box(x: float, y: float, angle: float, along: float, across: float, height: float, more: str) -> str:
    """A box that stands on the floor with its middle at x, y, m, turned by an angle, rad.

    along, across: half sizes along and across its direction, m."""
    size, place = f"{along:.8g} {across:.8g} {0.5 * height:.8g}", f"{x:.8g} {y:.8g} {0.5 * height:.8g}"
    return f'<geom type="box" size="{size}" pos="{place}" euler="0 0 {angle:.8g}" {more}/>'


def _wall(wall: Wall, height: float, settings: SimulatedSettings) -> list[str]:
    """Boxes of one wall: rows between openings, and the sides of the openings."""
    friction = _surface(settings)
    step = math.tau / settings.wall_segments
    openings = sorted(wall.openings, key=lambda o: o.angle % math.tau)
    if not openings:
        return _row(wall, _even(0.0, math.tau, step), height, friction)
    geoms: list[str] = []
    for opening, following in zip(openings, openings[1:] + openings[:1], strict=True):
        apart = (following.angle - opening.angle) % math.tau or math.tau
        geoms += _row(wall, _edges(wall, opening, following, apart, step), height, friction, (opening, following))
        geoms += _cheeks(wall, opening, height, friction)
    return geoms


def _surface(settings: SimulatedSettings) -> str:
    """Friction and contact attributes of all walls. With a damping ratio below 1 the ball bounces off.

    MuJoCo's stiffness is proportional to 1 / (time constant x damping ratio)^2. A lower ratio alone would make the wall
    too stiff for the time step, and every contact would add energy. So the time constant grows as the ratio falls.
    Without priority MuJoCo would use the mean of the values of wall and ball."""
    friction = f"{settings.wall_grip} {TORSIONAL} {settings.wall_rolling_friction_m}"
    ratio = settings.contact_damping_ratio
    time = TIME_CONSTANT if ratio >= 1.0 else f"{TIME_CONSTANT / ratio:.8g}"
    return f'friction="{friction}" solref="{time} {ratio}" priority="1"'


def _across(maze: Maze, wall: RadialWall, settings: SimulatedSettings) -> str:
    """The box of a radial wall, from the ring's inner wall to its outer one."""
    ring, half = maze.ring(wall.ring), 0.5 * wall.thickness
    near, far = math.sqrt(ring.inner_radius**2 - half**2), ring.outer_radius
    x, y = 0.5 * (near + far) * math.cos(wall.angle), 0.5 * (near + far) * math.sin(wall.angle)
    return _box(x, y, wall.angle, 0.5 * (far - near), half, maze.wall_height, _surface(settings))


def _even(start: float, end: float, step: float) -> list[float]:
    """Angles from start to end, at equal distances of at most a step; empty if end is not past start."""
    n = math.ceil((end - start) / step)
    return [] if n < 1 else [start + (end - start) * i / n for i in range(n + 1)]


def _edges(wall: Wall, opening: Opening, following: Opening, apart: float, step: float) -> list[float]:
    """Angles of the edges of the boxes from one opening to the next one, which is `apart` rad further on."""
    shoulder = SHOULDER / wall.outer_radius
    halves = [0.5 * o.width + CHEEK for o in (opening, following)]
    outer = [math.asin(half / wall.outer_radius) for half in halves]
    inner = [_clear_from(wall, half, step) for half in halves]
    if inner[0] + inner[1] >= apart:  # openings so close that no full box fits between them
        edges = _even(outer[0], apart - outer[1], shoulder)
    else:
        edges = _even(outer[0], inner[0], shoulder)[:-1] + _even(inner[0], apart - inner[1], step)
        edges += _even(apart - inner[1], apart - outer[1], shoulder)[1:]
    return [opening.angle + edge for edge in edges]


def _clear_from(wall: Wall, half: float, step: float) -> float:
    """Angle from an opening's middle line from which whole boxes of this step stay `half` (m) away from that line."""
    across = wall.outer_radius * math.tan(0.5 * step)  # half width of a box; its sides are parallel to its middle line
    corner = math.hypot(wall.inner_radius, across)
    return math.asin(min(1.0, half / corner)) + math.atan2(across, wall.inner_radius) - 0.5 * step


def _row(
    wall: Wall, edges: Sequence[float], height: float, friction: str, between: Sequence[Opening] = ()
) -> list[str]:
    """Boxes from edge to edge (angles, rad), cut off on the inside where they would reach into an opening."""
    boxes = []
    for start, end in pairwise(edges):
        angle, half_across = 0.5 * (start + end), wall.outer_radius * math.tan(0.5 * (end - start))
        near = max([wall.inner_radius, *(_cut(opening, angle, half_across) for opening in between)])
        if near < wall.outer_radius:
            along, half_along = 0.5 * (wall.outer_radius + near), 0.5 * (wall.outer_radius - near)
            c, s = math.cos(angle), math.sin(angle)
            boxes.append(_box(along * c, along * s, angle, half_along, half_across, height, friction))
    return boxes


def _cut(opening: Opening, angle: float, half_across: float) -> float:
    """Least radius, m, of the inner face of a box at this angle before the cheek's middle plane; 0 far from it."""
    turn = abs(difference(angle, opening.angle))
    if turn >= 0.5 * math.pi:
        return 0.0
    return (0.5 * opening.width + CHEEK + half_across * math.cos(turn)) / math.sin(turn)


def _cheeks(wall: Wall, opening: Opening, height: float, friction: str) -> list[str]:
    """The two cheeks of an opening: flat boxes parallel to its middle line, exactly its width apart.

    A cheek ends before its back would leave the wall's outer circle."""
    half = 0.5 * opening.width
    near = math.sqrt(wall.inner_radius**2 - half**2)
    far = math.sqrt(wall.outer_radius**2 - (half + 2.0 * CHEEK) ** 2)
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    along, boxes = 0.5 * (near + far), []
    for side in (-1.0, 1.0):
        across = side * (half + CHEEK)
        x, y = c * along - s * across, s * along + c * across
        boxes.append(_box(x, y, opening.angle, 0.5 * (far - near), CHEEK, height, friction))
    return boxes


def _plug(maze: Maze, opening: Opening) -> str:
    """A box that fills an opening. It collides with nothing unless a fault switches it on."""
    near, far = maze.ring(opening.inner).outer_radius, maze.ring(opening.outer).inner_radius
    along = 0.5 * (near + far)
    x, y = along * math.cos(opening.angle), along * math.sin(opening.angle)
    more = f'name="{plug_name(opening.name)}" contype="{PLUG_OFF}" conaffinity="{PLUG_OFF}" rgba="1 0 0 0.2"'
    return _box(x, y, opening.angle, 0.5 * (far - near), 0.5 * opening.width, maze.wall_height, more)


def plug_name(opening: str) -> str:
    """Name of the plug geom of an opening: other names for other openings, without the special characters of XML."""
    return "plug:" + "".join("_" if c == "@" else c if c.isalnum() or c in "- " else f"%{ord(c):x};" for c in opening)
