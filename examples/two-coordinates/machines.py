"""Two machines with two coordinates each, for `mazeplan diagnose`."""

from mazeplan.physics import Effect, Parameter, cos, sin

G = 9.81  # m/s^2


def moved(s, p, force, torque):
    """Accelerations of cart and pendulum under a force on the cart and a torque in the hinge."""
    light, ml = p.share * sin(s.theta) ** 2 + 1.0, p.length
    push = force + p.share * sin(s.theta) * (p.length * s.theta_dot**2 + G * cos(s.theta)) - torque * cos(s.theta) / ml
    z = push / light
    return z, -(z * cos(s.theta) + G * sin(s.theta)) / p.length + torque / (p.share * p.length**2)


class CartPendulum:
    """A cart on a rail under a known force over its mass, with a pendulum that hangs from it."""

    positions, units = ("z", "theta"), ("m", "rad")
    inputs = ("push",)
    parameters = {"share": Parameter("1", 0.3, 0.05, 1.0), "length": Parameter("m", 0.4, 0.1, 2.0)}  # noqa: RUF012  read only
    effects = (
        Effect(
            "rail_friction",
            {"coefficient": Parameter("1/s", 0.0, 0.0, 20.0)},
            formula=lambda s, p: (-p.coefficient * s.z_dot, p.coefficient * s.z_dot * cos(s.theta) / 0.5),
        ),
        "viscous_friction",
        "dry_friction",
    )

    @staticmethod
    def motion(s, p):
        """Accelerations of the cart, m/s^2, and of the pendulum, rad/s^2."""
        return moved(s, p, s.push, 0.0)


class BallOnPlate:
    """A ball that rolls on a plain plate under two measured tilts."""

    positions, units = ("x", "y"), "m"
    inputs = ("alpha", "beta")
    effects = ("viscous_friction", "dry_friction", "constant_force")

    @staticmethod
    def motion(s, p):
        """Accelerations along x and y, m/s^2."""
        return 5.0 / 7.0 * G * sin(s.alpha), 5.0 / 7.0 * G * sin(s.beta)
