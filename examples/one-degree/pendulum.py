"""A pendulum with a motor at its axle, for `mazeplan diagnose`."""

from mazeplan.physics import Parameter, sin


class Pendulum:
    """What is known: gravity and the motor's torque."""

    position, unit = "theta", "rad"
    inputs = ("torque",)
    parameters = {"mass": Parameter("kg", 0.2, 0.01, 5.0), "length": Parameter("m", 0.5, 0.1, 2.0)}  # noqa: RUF012
    effects = ("viscous_friction", "dry_friction", "quadratic_drag", "constant_torque")

    @staticmethod
    def motion(s, p):
        """The angular acceleration, rad/s^2."""
        return (s.torque / (p.mass * p.length) - 9.81 * sin(s.theta)) / p.length
