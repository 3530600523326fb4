"""Settings of a simulated rig, as they stand in its YAML file. Units are in the names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mazeplan.errors import SettingsError
from mazeplan.maze.yamltree import Key, Tree, key_path, read_yaml, shown

Surprise = Literal[
    "drawn", "table", "friction", "hollow", "magnet", "camera", "backlash", "warp",
    "viscous", "air", "push", "drift", "nap", "sticky", "kerb", "draught", "rocking", "unbalanced", "ripple", "wall",
    "gain", "slow_servo", "coupling", "late_command", "deadband",
    "tilt_scale", "turned_camera", "shifted_camera", "scaled_camera", "lens",
]  # fmt: skip
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Scale = Annotated[float, Field(ge=0.3, le=3.0)]
Share = Annotated[float, Field(ge=-0.5, le=0.5)]
Push = Annotated[float, Field(ge=-1.0, le=1.0)]  # m/s^2
Swing = Annotated[float, Field(ge=-4.0, le=4.0)]  # deg
Turn = Annotated[float, Field(ge=-360.0, le=360.0)]  # deg


PLAIN = {  # pydantic's kinds of errors, where its words are a programmer's
    "model_type": "settings as `key: value`", "model_attributes_type": "settings as `key: value`",
    "dict_type": "settings as `key: value`", "tuple_type": "a list", "list_type": "a list", "string_type": "text",
    "bool_type": "true or false", "finite_number": "a finite number",
}  # fmt: skip


class Section(BaseModel):
    """Base of all sections: unknown keys, NaN and text where a number belongs are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Fault(Section):
    """Something that goes wrong on purpose, from at_s on for duration_s.

    stuck: the ball is glued where it is; blackout: the camera sees nothing; blocked: a plug in `opening`; push: a kick
    of `speed_m_s` towards `direction_deg` at at_s; teleport: at at_s the ball is put to rest in `ring` at
    `direction_deg`; removed: the ball is taken out, and put back where it was.
    Of the servo `axis`: dead_axis: no longer follows commands; slow_axis: follows at `slew_deg_s` at most; offset_axis:
    stands `offset_deg` beside them; brown_out: without current, a spring in it goes back to its middle."""

    kind: Literal[
        "stuck", "blackout", "dead_axis", "blocked", "push",
        "teleport", "removed", "slow_axis", "offset_axis", "brown_out",
    ]  # fmt: skip
    at_s: float = Field(ge=0.0)
    duration_s: float = Field(default=1.0, ge=0.0)
    axis: Literal["beta", "gamma", "both"] = "beta"
    opening: str | None = None
    ring: int = Field(default=1, ge=1)
    speed_m_s: float = Field(default=0.1, ge=0.0, le=2.0)
    direction_deg: float = 0.0
    slew_deg_s: float = Field(default=10.0, ge=0.1, le=2000.0)
    offset_deg: float = Field(default=1.0, ge=-5.0, le=5.0)


class Change(Section):
    """What is otherwise from run `from_run` of a campaign on, the first being 1: keys of the settings themselves."""

    from_run: int = Field(ge=1)
    rolling_friction_m: float | None = Field(default=None, ge=0.0, le=1e-3)
    floor_friction: float | None = Field(default=None, ge=0.0, le=2.0)
    wall_grip: float | None = Field(default=None, ge=0.0, le=2.0)
    contact_damping_ratio: float | None = Field(default=None, ge=0.02, le=5.0)
    table_x_deg: float | None = Field(default=None, ge=-4.0, le=4.0)
    table_y_deg: float | None = Field(default=None, ge=-4.0, le=4.0)


class SimulatedSettings(Section):
    """All that can be set on the simulated rig. The defaults are an ideal machine; every key may be edited."""

    model: str | None = Field(default=None, description="model of ball and stage to navigate with: a name or folder")
    map: str | None = Field(default=None, description="map of the machine itself, where the planner has another")
    rate_hz: float = Field(default=30.0, ge=5.0, le=200.0, description="samples and commands per second")
    # camera
    sense: Literal["ideal", "camera"] = Field(
        default="ideal",
        description="camera: the ball is found in rendered pictures, without camera_noise_mm and outliers",
    )
    camera_noise_mm: float = Field(default=0.0, ge=0.0, le=20.0, description="1 sigma per axis")
    camera_delay_frames: int = Field(default=0, ge=0, le=15, description="age of the picture, in samples")
    camera_late_ms: float = Field(default=0.0, ge=0.0, le=300.0, description="what comes to that age")
    ball_lost_probability: Fraction = Field(default=0.0, description="per sample, that the ball is lost")
    ball_lost_frames: int = Field(default=3, ge=1, le=300, description="for how many samples it then is")
    outlier_probability: Fraction = Field(default=0.0, description="per sample, of a wrong position")
    outlier_mm: float = Field(default=30.0, ge=0.0, le=200.0, description="1 sigma of a wrong position")
    camera_offset_mm: tuple[float, float] = Field(default=(0.0, 0.0), description="x, y of the picture's centre")
    camera_rotation_deg: float = Field(default=0.0, ge=-10.0, le=10.0, description="of the picture against the plate")
    camera_scale: float = Field(default=1.0, ge=0.5, le=2.0, description="size of the picture: seen over true")
    lens_per_m2: float = Field(
        default=0.0, ge=-30.0, le=30.0,
        description="bent picture: distances from lens_mm grow by this times their square",
    )  # fmt: skip
    lens_mm: tuple[float, float] = Field(default=(0.0, 0.0), description="x, y of the place that the lens leaves alone")
    # tilt
    tilt_noise_deg: float = Field(default=0.0, ge=0.0, le=2.0, description="1 sigma of the tilt sensor")
    table_x_deg: float = Field(default=0.0, ge=-4.0, le=4.0, description="table off level about x; + lifts the +y side")
    table_y_deg: float = Field(
        default=0.0, ge=-4.0, le=4.0, description="table off level about y; + lowers the +x side"
    )
    tilt_scale: tuple[Scale, Scale] = Field(default=(1.0, 1.0), description="beta, gamma of the sensor over true ones")
    rocking_deg: tuple[Swing, Swing] = Field(
        default=(0.0, 0.0), description="beta, gamma by which the table rocks, unseen by the tilt sensor: amplitudes"
    )
    rocking_hz: float = Field(default=1.0, ge=0.0, le=15.0, description="swings of a rocking table per second")
    rocking_phase_deg: Turn = Field(default=0.0, description="of a rocking table at time 0; 0: level, on its way up")
    # servo
    servo_frequency_rad_s: float = Field(default=26.0, ge=5.0, le=100.0, description="natural frequency")
    servo_damping: float = Field(default=0.9, ge=0.3, le=3.0)
    servo_gamma_frequency_rad_s: float | None = Field(
        default=None, ge=5.0, le=100.0, description="of gamma's servo, where it is not as beta's"
    )
    servo_gamma_damping: float | None = Field(
        default=None, ge=0.3, le=3.0, description="of gamma's servo, where it is not as beta's"
    )
    servo_gain: tuple[Scale, Scale] = Field(default=(1.0, 1.0), description="tilt over command: beta, gamma")
    servo_coupling: tuple[Share, Share] = Field(
        default=(0.0, 0.0), description="share of the other axis's command that beta, gamma follows, too"
    )
    servo_slew_deg_s: float = Field(default=120.0, ge=5.0, le=2000.0, description="fastest change of the set point")
    command_delay_ms: float = Field(default=0.0, ge=0.0, le=300.0, description="before the servo hears a command")
    backlash_deg: float = Field(default=0.0, ge=0.0, le=2.0, description="play between servo and plate")
    backlash_axis: Literal["both", "beta", "gamma"] = Field(default="both", description="which servo has it")
    deadband_deg: float = Field(default=0.0, ge=0.0, le=2.0, description="smallest change of command that is obeyed")
    # ball and plate
    ball_inertia: float = Field(default=0.4, ge=0.1, le=0.6667, description="of m r^2: 2/5 solid, 2/3 hollow")
    magnet_m_s2: float = Field(default=0.0, ge=0.0, le=2.0, description="strongest pull of a magnet under the plate")
    magnet_mm: tuple[float, float] = Field(default=(0.0, 0.0), description="x, y of the magnet")
    magnet_depth_mm: float = Field(default=15.0, ge=3.0, le=50.0, description="below the ball's centre")
    warp_mm: float = Field(default=0.0, ge=0.0, le=5.0, description="height at the edge of a plate bent to a saddle")
    warp_deg: float = Field(default=0.0, ge=-180.0, le=180.0, description="direction in which the edge is highest")
    drag_per_s: float = Field(default=0.0, ge=0.0, le=10.0, description="share of its speed that the ball loses in 1 s")
    drag_per_m: float = Field(default=0.0, ge=0.0, le=20.0, description="share of its speed that the ball loses in 1 m")
    drag_growth_per_s2: float = Field(default=0.0, ge=0.0, le=0.1, description="by how much drag_per_s grows in 1 s")
    ring_push_m_s2: Push = Field(default=0.0, description="steady push along the ring; + counter-clockwise")
    draught_m_s2: tuple[Push, Push] = Field(
        default=(0.0, 0.0), description="x, y of a steady wind in the room: force over the mass of the ball"
    )
    imbalance_m_s2: float = Field(
        default=0.0, ge=0.0, le=1.0, description="ball that is heavier on one side: largest push along the ring"
    )
    imbalance_phase_deg: Turn = Field(default=0.0, description="of that push where the ball has not rolled since 0 deg")
    ripple_m_s2: float = Field(default=0.0, ge=0.0, le=1.0, description="wavy floor: largest push along the ring")
    ripple_waves: int = Field(default=6, ge=1, le=17, description="waves of the floor in a full circle")
    ripple_deg: Turn = Field(default=0.0, description="direction of a crest")
    nap_m_s2: Push = Field(default=0.0, description="dry friction of a ball that rolls counter-clockwise; -: clockwise")
    sticky_m_s2: float = Field(default=0.0, ge=0.0, le=1.0, description="dry friction in a part of a ring")
    sticky_ring: int = Field(default=1, ge=1, description="which ring that is")
    sticky_deg: tuple[Turn, Turn] = Field(default=(0.0, 60.0), description="from where to where, counter-clockwise")
    kerb_loss: float = Field(default=0.0, ge=0.0, le=0.9, description="share of the speed that is lost at one angle")
    kerb_ring: int = Field(default=1, ge=1, description="in which ring")
    kerb_deg: Turn = Field(default=0.0, description="at which angle")
    # contact
    rolling_friction_m: float = Field(default=2e-5, ge=0.0, le=1e-3, description="stiction angle = this / ball radius")
    floor_friction: float = Field(default=0.3, ge=0.0, le=2.0, description="sliding; low: the ball slips")
    wall_grip: float = Field(default=0.3, ge=0.0, le=2.0, description="sliding friction of walls; it spins the ball")
    contact_damping_ratio: float = Field(default=1.0, ge=0.02, le=5.0, description="below 1 the ball bounces off walls")
    wall_rolling_friction_m: float = Field(
        default=2e-5, ge=0.0, le=1e-3, description="of a ball that turns against a wall, as rolling_friction_m"
    )
    wall_segments: int = Field(default=360, ge=192, le=1440, description="boxes per full circle of wall")
    faults: tuple[Fault, ...] = ()
    changes: tuple[Change, ...] = Field(default=(), description="what is otherwise from some run of a campaign on")
    surprise: Surprise | None = Field(
        default=None, description="one thing that is not as it was, by its name; drawn: one of the first seven"
    )
    surprise_seed: int = Field(default=0, ge=0, description="of what is drawn, and of its size and place")


def in_run(settings: SimulatedSettings, number: int) -> SimulatedSettings:
    """The settings as they are in a run of a campaign, the first being 1."""
    due = sorted((c for c in settings.changes if c.from_run <= number), key=lambda change: change.from_run)
    changed = {k: v for c in due for k, v in c.model_dump(exclude={"from_run"}).items() if v is not None}
    return settings.model_copy(update=changed) if changed else settings


def settings_from(
    data: Mapping[str, Any], *, file: str | Path | None = None, tree: Tree | None = None
) -> SimulatedSettings:
    """Validated settings. Raises SettingsError with file, line and key."""
    try:
        return SimulatedSettings.model_validate(as_tuples(data))
    except ValidationError as problem:
        first = problem.errors()[0]
        key: Key = tuple(first["loc"])
        raise SettingsError(
            _said(first), file=file, line=None if tree is None else tree.line(key), key=key_path(key) or None
        ) from None


def as_tuples(value: Any) -> Any:
    """Lists as tuples: strict validation takes them for fixed-length settings."""
    if isinstance(value, Mapping):
        return {key: as_tuples(item) for key, item in value.items()}
    return tuple(as_tuples(item) for item in value) if isinstance(value, list | tuple) else value


def _said(error: Any) -> str:
    if error["type"] == "extra_forbidden":
        inside = next((kind for name, kind in (("faults", Fault), ("changes", Change)) if name in error["loc"]), None)
        fields = (inside or SimulatedSettings).model_fields
        return f"unknown key, expected one of {', '.join(fields)}"
    return sentence(error)


def sentence(error: Any) -> str:
    """One of pydantic's errors in words: what was got, what is allowed."""
    message = str(error["msg"])
    if error["type"] == "value_error":  # a validator of ours, which says all
        return message.removeprefix("Value error, ")
    if error["type"] == "missing":
        return "is missing"
    got, kind = error.get("input"), error["type"]
    if kind in ("too_long", "too_short"):
        most = error["ctx"].get("max_length", error["ctx"].get("min_length"))
        return f"got {len(got)} entries, expected {'at most' if kind == 'too_long' else 'at least'} {most}"
    expected = PLAIN.get(kind) or message.removeprefix("Input should be ").removeprefix("Field ")
    return f"got {shown(list(got) if isinstance(got, tuple) else got)}, expected {expected}"


class FileSettings(dict[str, Any]):
    """Settings of a rig out of a file, which knows where it is, and where its keys stand."""

    def __init__(self, data: Mapping[str, Any], file: Path, tree: Tree) -> None:
        super().__init__(data)
        self.file, self.tree = file, tree


def placed(problem: SettingsError, settings: Mapping[str, Any]) -> SettingsError:
    """The same error with file and line of its key, where the settings come out of a file and it does not say."""
    if problem.file is not None or not isinstance(settings, FileSettings):
        return problem
    line = None if problem.key is None else settings.tree.line(parsed_key(problem.key))
    return SettingsError(problem.problem, file=settings.file, line=line, key=problem.key)


def parsed_key(text: str) -> Key:
    """`camera.size[0]` as a key path."""
    return tuple(int(part) if part.isdigit() else part for part in re.findall(r"[^.\[\]]+", text))


def read_rig_file(path: Path) -> tuple[str | None, dict[str, Any], Tree]:
    """(class or None, the other keys, the tree for line numbers) of a rig's YAML file. Raises SettingsError."""
    tree = read_yaml(path, error=SettingsError, what="the settings of a rig (YAML)")
    if not isinstance(tree.data, dict):
        raise SettingsError(f"got {shown(tree.data)}, expected settings as `key: value`", file=path, line=1)
    data = dict(tree.data)
    kind = data.pop("class", None)
    if kind is not None and not isinstance(kind, str):
        raise SettingsError(
            f"got {shown(kind)}, expected module:Class", file=path, line=tree.line(("class",)), key="class"
        )
    return kind, data, tree
