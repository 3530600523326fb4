"""Settings of a simulated rig. They are the keys of its YAML file; units are in the names.

The file has all keys at its top level.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from mazeplan.maze.sections import Section

Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Scale = Annotated[float, Field(ge=0.3, le=3.0)]
Share = Annotated[float, Field(ge=-0.5, le=0.5)]
Push = Annotated[float, Field(ge=-1.0, le=1.0)]  # m/s^2
Lean = Annotated[float, Field(ge=-4.0, le=4.0)]  # deg
Turn = Annotated[float, Field(ge=-360.0, le=360.0)]  # deg


class Fault(Section):
    """A fault of the machine. It begins at at_s and lasts for duration_s.

    Kinds that act on a ball (`ball`: 1 is the first): stuck (glued to the floor), push (a kick of `speed_m_s` towards
    `direction_deg`), teleport (put to rest in `ring` at `direction_deg`), removed (taken out, and put back at the end).
    Kinds that act on the servo of `axis`: dead_axis (follows no command), slow_axis (at most `slew_deg_s`), offset_axis
    (`offset_deg` beside its set point), brown_out (without current, a spring moves it to its middle).
    Others: blackout (the camera sees nothing), blocked (a plug is in `opening`)."""

    kind: Literal[
        "stuck", "blackout", "dead_axis", "blocked", "push",
        "teleport", "removed", "slow_axis", "offset_axis", "brown_out",
    ]  # fmt: skip
    at_s: float = Field(ge=0.0)
    duration_s: float = Field(default=1.0, ge=0.0)
    axis: Literal["beta", "gamma", "both"] = "beta"
    opening: str | None = None
    ball: int = Field(default=1, ge=1)
    ring: int = Field(default=1, ge=1)
    speed_m_s: float = Field(default=0.1, ge=0.0, le=2.0)
    direction_deg: float = 0.0
    slew_deg_s: float = Field(default=10.0, ge=0.1, le=2000.0)
    offset_deg: float = Field(default=1.0, ge=-5.0, le=5.0)


class RigSettings(Section):
    """Keys of every simulated rig, also of one on a user's model."""

    model: str | None = Field(default=None, description="model of ball and stage for navigation: a name or folder")
    rate_hz: float = Field(default=30.0, ge=5.0, le=200.0, description="samples and commands per second")
    # delay, noise and losses of the camera
    camera_noise_mm: float = Field(default=0.0, ge=0.0, le=20.0, description="standard deviation per axis")
    camera_delay_frames: int = Field(default=0, ge=0, le=15, description="age of the picture, in samples")
    camera_late_ms: float = Field(default=0.0, ge=0.0, le=300.0, description="further age of the picture")
    ball_lost_probability: Fraction = Field(default=0.0, description="per sample, that the camera loses the ball")
    ball_lost_frames: int = Field(default=3, ge=1, le=300, description="samples for which the ball stays lost")
    outlier_probability: Fraction = Field(default=0.0, description="per sample, of a wrong position")
    outlier_mm: float = Field(default=30.0, ge=0.0, le=200.0, description="standard deviation of a wrong position")
    # errors of the camera's place and lens
    camera_offset_mm: tuple[float, float] = Field(default=(0.0, 0.0), description="x, y of the picture's centre")
    camera_rotation_deg: float = Field(default=0.0, ge=-10.0, le=10.0, description="of the picture against the plate")
    camera_scale: float = Field(default=1.0, ge=0.5, le=2.0, description="size of the picture: measured over true")
    lens_per_m2: float = Field(default=0.0, ge=-30.0, le=30.0, description="k: a distance d becomes d (1 + k d^2)")
    lens_mm: tuple[float, float] = Field(default=(0.0, 0.0), description="x, y of the lens's centre")
    # tilt sensor
    tilt_noise_deg: float = Field(default=0.0, ge=0.0, le=2.0, description="standard deviation of the tilt sensor")
    tilt_scale: tuple[Scale, Scale] = Field(default=(1.0, 1.0), description="beta, gamma: measured over true tilt")
    # servos and commands
    servo_gain: tuple[Scale, Scale] = Field(default=(1.0, 1.0), description="beta, gamma: tilt over command")
    servo_coupling: tuple[Share, Share] = Field(
        default=(0.0, 0.0), description="share of the other command that is added"
    )
    servo_slew_deg_s: float = Field(default=120.0, ge=5.0, le=2000.0, description="fastest change of the set point")
    command_delay_ms: float = Field(default=0.0, ge=0.0, le=300.0, description="from a command to the servo")
    backlash_deg: float = Field(default=0.0, ge=0.0, le=2.0, description="play between servo and plate")
    backlash_axis: Literal["both", "beta", "gamma"] = Field(default="both", description="axis of the play")
    deadband_deg: float = Field(default=0.0, ge=0.0, le=2.0, description="servos ignore smaller changes of a command")
    faults: tuple[Fault, ...] = ()


class SimulatedSettings(RigSettings):
    """All keys of a simulated rig's file. The defaults describe an ideal machine."""

    map: str | None = Field(default=None, description="map of the machine, if it is not the planner's")
    # servos
    servo_frequency_rad_s: float = Field(default=26.0, ge=5.0, le=100.0, description="natural frequency")
    servo_damping: float = Field(default=0.9, ge=0.3, le=3.0)
    servo_gamma_frequency_rad_s: float | None = Field(default=None, ge=5.0, le=100.0, description="default: as beta's")
    servo_gamma_damping: float | None = Field(default=None, ge=0.3, le=3.0, description="default: as beta's")
    # table under the plate
    table_x_deg: Lean = Field(default=0.0, description="lean of the table about x; + lifts the +y side")
    table_y_deg: Lean = Field(default=0.0, description="lean of the table about y; + lowers the +x side")
    rocking_deg: tuple[Lean, Lean] = Field(default=(0.0, 0.0), description="beta, gamma: amplitude of a rocking table")
    rocking_hz: float = Field(default=1.0, ge=0.0, le=15.0, description="swings of a rocking table per second")
    rocking_phase_deg: Turn = Field(default=0.0, description="phase of a rocking table at time 0")
    # ball, and forces along its way
    ball_inertia: float = Field(default=0.4, ge=0.1, le=0.6667, description="of m r^2: 2/5 solid, 2/3 hollow")
    drag_per_s: float = Field(default=0.0, ge=0.0, le=10.0, description="share of its speed that the ball loses in 1 s")
    drag_per_m: float = Field(default=0.0, ge=0.0, le=20.0, description="share of its speed that the ball loses in 1 m")
    drag_growth_per_s2: float = Field(default=0.0, ge=0.0, le=0.1, description="growth of drag_per_s in 1 s")
    ring_push_m_s2: Push = Field(default=0.0, description="steady push along the ring; + counter-clockwise")
    draught_m_s2: tuple[Push, Push] = Field(default=(0.0, 0.0), description="x, y of a steady wind in the room")
    imbalance_m_s2: float = Field(
        default=0.0, ge=0.0, le=1.0, description="by an eccentric mass of the ball: the largest"
    )
    imbalance_phase_deg: Turn = Field(default=0.0, description="its heavy side: 0 on top, 90 along the ring")
    # forces of the plate: a magnet, a warped or wavy floor
    magnet_m_s2: float = Field(default=0.0, ge=0.0, le=2.0, description="strongest pull of a magnet under the plate")
    magnet_mm: tuple[float, float] = Field(default=(0.0, 0.0), description="x, y of the magnet")
    magnet_depth_mm: float = Field(default=15.0, ge=3.0, le=50.0, description="below the ball's centre")
    warp_mm: float = Field(default=0.0, ge=0.0, le=5.0, description="plate bent to a saddle: height at its edge")
    warp_deg: float = Field(default=0.0, ge=-180.0, le=180.0, description="direction of the highest edge")
    ripple_m_s2: float = Field(default=0.0, ge=0.0, le=1.0, description="wavy floor: largest push along the ring")
    ripple_waves: int = Field(default=6, ge=1, le=17, description="waves of the floor in a full circle")
    ripple_deg: Turn = Field(default=0.0, description="direction of a crest")
    # losses that depend on direction or place: a nap, a sticky part of a ring, a kerb
    nap_m_s2: Push = Field(default=0.0, description="dry friction of a ball that rolls counter-clockwise; -: clockwise")
    sticky_m_s2: float = Field(default=0.0, ge=0.0, le=1.0, description="dry friction in a part of a ring")
    sticky_ring: int = Field(default=1, ge=1, description="ring of the sticky part")
    sticky_deg: tuple[Turn, Turn] = Field(default=(0.0, 60.0), description="from, to, counter-clockwise")
    kerb_loss: float = Field(default=0.0, ge=0.0, le=0.9, description="share of the speed that a kerb takes")
    kerb_ring: int = Field(default=1, ge=1, description="ring of the kerb")
    kerb_deg: Turn = Field(default=0.0, description="angle of the kerb")
    # contacts of the ball with floor and walls
    rolling_friction_m: float = Field(default=2e-5, ge=0.0, le=1e-3, description="stiction angle = this / ball radius")
    floor_friction: float = Field(default=0.3, ge=0.0, le=2.0, description="sliding; low: the ball slips")
    wall_grip: float = Field(default=0.3, ge=0.0, le=2.0, description="sliding friction of walls; it spins the ball")
    contact_damping_ratio: float = Field(default=1.0, ge=0.02, le=5.0, description="below 1 the ball bounces off walls")
    wall_rolling_friction_m: float = Field(default=2e-5, ge=0.0, le=1e-3, description="of a ball that turns at a wall")
    wall_segments: int = Field(default=360, ge=192, le=1440, description="boxes per full circle of wall")
