"""A class of a few lines becomes a system whose missing effects are named; records come from plain time stepping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ring_records import names, parameters

from mazeplan.core.errors import InputError
from mazeplan.diagnosis.coordinate.kalman import NODES
from mazeplan.diagnosis.mechanism.diagnose import diagnose_mechanism
from mazeplan.diagnosis.mechanism.drive_log import MotionLog
from mazeplan.diagnosis.mechanism.mechanism import mechanism_of
from mazeplan.diagnosis.mechanism.scores import course_of, sized
from mazeplan.diagnosis.mechanism.system import MechanismSystem
from mazeplan.physics import Effect, Parameter, sin

MASS = Parameter("kg", 1.0, 0.01, 100.0)


class Cart:
    position, unit = "x", "m"
    inputs = held = "push"
    force, inertia = "push", "mass"
    parameters = {"mass": MASS}  # noqa: RUF012

    @staticmethod
    def motion(s, p):
        return s.push / p.mass


class Free:
    """Without inputs and without parameters: everything about it is missing."""

    position, unit = "angle", "rad"
    effects = ("elastic_force", "viscous_friction", "dry_friction")

    @staticmethod
    def motion(s, p):
        return 0 * s.position


def cart(rate=100.0, seconds=30.0, mass=2.0, dry=0.0, viscous=0.0, noise=1e-4, fine=20):
    """A cart that is pushed and pulled, its force held from sample to sample; dry N, viscous N s/m."""
    rng = np.random.default_rng(3)
    n, h = round(seconds * rate), 1.0 / rate / fine
    t = np.arange(n) / rate
    force = 3.0 * np.sin(2.5 * t + 2.0 * np.sin(0.4 * t)) + 2.0 * np.sign(np.sin(1.1 * t))
    x, v, out = 0.0, 0.0, np.empty(n)
    for k in range(n):
        out[k] = x
        for _ in range(fine):
            free, most = v + h * (force[k] - viscous * v) / mass, h * dry / mass
            new = 0.0 if abs(free) <= most else free - math.copysign(most, free)
            x, v = x + 0.5 * h * (v + new), new
    return MotionLog(1.0 / rate, out + noise * rng.standard_normal(n), force[:, None])


def value(done, name, parameter):
    return parameters(done, name)[parameter]


@pytest.mark.slow
@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_friction_of_a_cart_is_a_force_in_n(rate):
    log = cart(rate=rate, dry=1.5, fine=20 if rate < 500.0 else 4)
    log.position[200:230] = np.nan  # nobody looked
    done = diagnose_mechanism(mechanism_of(Cart), log, {})
    assert names(done) == ["dry_friction"], done.sentence()
    found = value(done, "dry_friction", "coefficient")
    assert found["value"] == pytest.approx(1.5, rel=0.03)
    assert found["unit"] == "N"
    assert done.fitted[0]["parameters"]["mass"]["value"] == pytest.approx(2.0, rel=0.02)
    assert done.after.nrmse < 0.5 * done.before.nrmse
    assert done.after.free_run < 0.2 * done.before.free_run
    assert "mm off" in done.sentence()
    assert "force error" in done.sentence()


def test_where_nothing_is_missing_it_says_so():
    done = diagnose_mechanism(mechanism_of(Cart), cart(viscous=0.8), {"viscous_friction": {"coefficient": 0.8}})
    assert done.verdict == "nothing_missing", done.sentence()


def test_an_input_that_is_not_held_goes_along_a_straight_line():
    class Line(Cart):
        held = ()

    log = cart(rate=20.0, fine=100)
    held, line = (diagnose_mechanism(mechanism_of(c), log, {"motion": {"mass": 2.0}}) for c in (Cart, Line))
    assert held.verdict == "nothing_missing", held.sentence()
    assert held.after.free_run < 0.3 * line.before.free_run


def test_a_motion_may_know_nothing():
    t = np.arange(0.0, 40.0, 0.02)
    x = 1.2 * np.exp(-0.05 * t) * np.cos(4.0 * t)
    x += 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    done = diagnose_mechanism(mechanism_of(Free), MotionLog(0.02, x, np.empty((len(t), 0))), {})
    assert names(done) == ["elastic_force", "viscous_friction"], done.sentence()
    assert value(done, "elastic_force", "stiffness") == {
        "value": pytest.approx(16.0 + 0.05**2, rel=0.01), "stderr": pytest.approx(0.0, abs=0.05), "unit": "1/s^2",
    }  # fmt: skip
    assert value(done, "viscous_friction", "coefficient")["value"] == pytest.approx(0.1, rel=0.1)


def test_of_the_motion_some_may_be_known():
    class Pendulum:
        position, unit, inputs = "theta", "rad", ("torque",)
        parameters = {"mass": MASS, "length": Parameter("m", 0.5, 0.1, 3.0)}  # noqa: RUF012

        @staticmethod
        def motion(s, p):
            return (s.torque / (p.mass * p.length) - 9.81 * sin(s.theta)) / p.length

    t = np.arange(0.0, 30.0, 0.01)
    torque, x, v, out = 0.4 * np.sin(3.0 * t + 2.0 * np.sin(0.5 * t)), 0.3, 0.0, np.empty(len(t))
    for k in range(len(t)):
        out[k] = x
        for _ in range(50):
            a = torque[k] / (0.5 * 0.36) - 9.81 / 0.6 * math.sin(x)
            x, v = x + 2e-4 * v + 2e-8 * a, v + 2e-4 * a
    out += 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    log = MotionLog(0.01, out, torque[:, None])

    class Held(Pendulum):
        held = "torque"

    done = diagnose_mechanism(mechanism_of(Held), log, {"motion": {"mass": 0.5}})
    assert done.verdict == "nothing_missing", done.sentence()
    (fitted,) = done.fitted
    assert list(fitted["parameters"]) == ["length"]
    assert fitted["parameters"]["length"]["value"] == pytest.approx(0.6, rel=0.005)
    wrong = diagnose_mechanism(mechanism_of(Held), log, {"motion": {"mass": 0.5, "length": 0.66}})
    assert value(wrong, "motion", "length")["value"] == pytest.approx(0.6, rel=0.005)


def test_forces_of_the_motion_are_not_divided_by_the_inertia_twice():
    class Spring(Cart):
        parameters = {"mass": MASS, "stiffness": Parameter("N/m", 8.0, 0.0, 100.0)}  # noqa: RUF012
        effects = ("dry_friction",)

        @staticmethod
        def motion(s, p):
            return (s.push - p.stiffness * s.position) / p.mass

    spring, x = mechanism_of(Spring), np.linspace(-0.5, 0.5, 101)
    values = {"motion": {"mass": 2.0, "stiffness": 8.0}, "dry_friction": {"coefficient": 3.0}}
    system = MechanismSystem(spring, 0.01, x, np.zeros((101, NODES, 1)), {})
    assert system.modelled([spring.motion], values, np.zeros(101)) == pytest.approx(-8.0 / 2.0 * x)
    _, p = system.build(spring.library, values)
    assert p.tolist()[:3] == [2.0, 8.0, 1.5], "the friction is found in N"


@pytest.mark.parametrize("rows", [150, 300])
def test_a_record_may_be_shorter_than_what_is_left_out_around_a_gap(rows):
    log = cart(rate=1000.0, seconds=0.3, fine=1)
    log = MotionLog(log.dt, log.position[:rows], log.inputs[:rows])
    log.position[20] = np.nan
    course = course_of(mechanism_of(Cart), log, {})
    assert np.flatnonzero(course.seen).tolist() == list(range(121, rows))


def test_sizes_follow_from_the_record_unless_an_effect_brings_them():
    class Two(Cart):
        effects = (
            "viscous_friction",
            Effect("mine", {"size": Parameter("N", 0.0, -9.0, 9.0, smallest=0.3)}, formula=lambda s, p: p.size),
            Effect("yours", {"size": Parameter("N", 0.0, -9.0, 9.0)}, formula=lambda s, p: p.size),
        )

    log = cart()
    motion, viscous, mine, yours = sized(course_of(mechanism_of(Two), log, {}))[0]
    worth = 0.02 * float(np.sqrt(np.mean(log.inputs**2)))
    fastest = float(np.abs(np.gradient(log.position, log.dt)).max())
    assert viscous.parameters["coefficient"].smallest == pytest.approx(worth / fastest, rel=0.1)
    assert mine.parameters["size"].smallest == 0.3
    assert yours.parameters["size"].smallest == pytest.approx(worth)
    assert motion.parameters["mass"].smallest == pytest.approx(0.02 * 2.0, rel=0.1)


def test_units_are_those_of_the_position():
    def units(**told):
        found = mechanism_of(type("Some", (Cart,), told)).effects
        return {e.name: p.unit for e in found for p in e.parameters.values()}

    force = {"viscous_friction": "N s/m", "dry_friction": "N", "quadratic_drag": "N s^2/m^2", "elastic_force": "N/m"}
    assert units().items() >= force.items()
    assert units(unit="rad")["quadratic_drag"] == "N m s^2/rad^2"
    plain = units(force="", inertia="")
    assert (plain["quadratic_drag"], plain["dry_friction"]) == ("1/m", "m/s^2")
    one = units(force="", inertia="", effects="surface_bump", unit="rad")
    assert one == {"surface_bump": "rad/s^2"}


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"unit": ""}, "unit: got '', expected a name"),
        ({"inputs": ("theta_dot",)}, "inputs: got 'theta_dot', expected names of columns but theta"),
        ({"inputs": 3}, "inputs: got 3, expected names"),
        ({"held": "pull"}, "held: got 'pull', expected one of push"),
        ({"inertia": "weight"}, "inertia: got 'weight', expected one of mass"),
        ({"force": ""}, "force: got '', expected one of push"),
        ({"parameters": {"mass": 2.0}}, "motion.mass: got 2.0, expected Parameter(unit, value, lowest, highest)"),
        ({"parameters": {"mass": Parameter("kg", 9.0, 0.0, 1.0)}}, "motion.mass: got value 9, expected 0 to 1"),
        ({"parameters": MASS}, "expected a dictionary of Parameter by name"),
        ({"effects": ("wind",)}, "effects: got 'wind', expected an Effect or one of viscous_friction"),
        ({"effects": "tilt_offset"}, "effects: got 'tilt_offset', expected an Effect or one of"),
        ({"effects": 5}, "effects: got 5, expected an Effect or one of"),
        ({"effects": ("dry_friction", "dry_friction")}, "got the effect 'dry_friction', expected names"),
        ({"effects": "ball_imbalance"}, "the formula of ball_imbalance cannot be used: got ball_radius, radius in a"),
        ({"effects": Effect("none", {}, formula=lambda s, p: s.t)}, "none: got no parameters, expected at least one"),
        (
            {"effects": Effect("none", {"a": MASS}, "stage")},
            "none: got an effect on stage, expected a formula of force",
        ),
        ({"motion": lambda s, p: s.wind / p.mass}, "the formula of motion cannot be used: got wind in a formula"),
        ({"motion": lambda s, p: s.push / p.weight}, "the formula of motion cannot be used: "),
        ({"motion": lambda s: s.push}, "the formula of motion cannot be used: "),
        ({"motion": 9.81}, "motion: got an effect on force, expected a formula"),
    ],
)
def test_what_cannot_be_used_is_told(told, message):
    with pytest.raises(InputError) as caught:
        mechanism_of(type("Wrong", (Cart,), told))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_formula_that_gives_no_number_is_told():
    class Root(Cart):
        effects = Effect("root", {"a": MASS}, formula=lambda s, p: p.a * (s.position - 100.0) ** 0.5)

    with pytest.raises(InputError, match=r"the formula of root gives nan at position .*, speed .*, a 1; expected"):
        diagnose_mechanism(mechanism_of(Root), cart(seconds=5.0), {})
