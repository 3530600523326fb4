"""Steers the ball by a learned policy along a ring and through an opening, as long as the policy knows such states."""

from __future__ import annotations

from typing import ClassVar

from mazeplan.behavior.mazeleaf import OpeningLeaf
from mazeplan.behavior.opening_leaves import gets_in
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.opening import aligned
from mazeplan.control.policy import Policy, policy_inputs
from mazeplan.core.errors import InputError
from mazeplan.core.maths.angles import difference, nearest
from mazeplan.core.records import FailureKind


class FollowPolicy(OpeningLeaf):
    """Bring the ball to the opening and through it by the run's learned policy, without a plan."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening to go through", choices="openings"),
        "max_distance": Port(
            float, 1.5, "distance to the training data beyond which it fails; 1 holds 99.9 % of them", least=0.0
        ),
        "timeout_s": Port(float, 5.0, "after that the opening counts as missed", least=0.0),
    }

    def start(self) -> None:
        """Remember where the leg begins, and which way round it goes."""
        super().start()
        self._turn, self._passing = self.context.turn_to(self.current_opening()), False

    def step(self) -> Status:
        """SUCCESS in the next ring; FAILURE unfamiliar where the policy knows no such state, stuck, missed_opening,
        opening_closed, route_changed, fell_back, wrong_ring."""
        run, here, opening = self.context, self.context.here, self.current_opening()
        target = opening.leads_to(self._ring)
        elsewhere = self.elsewhere(self._ring, opening) or self.walled_off(opening)
        elsewhere = elsewhere or (None if self._passing else self.rerouted())
        if elsewhere is not None:
            return elsewhere
        if run.now - self._began > self.get("timeout_s"):
            run.graph.record(opening.name, success=False)
            return self.missed(opening, self._ring, f"not through {opening.name} in time")
        if self._still.standing(run.measured):
            return self.fail_as(FailureKind.STUCK, f"standing on the way to {opening.name}")
        self._passing = self._passing or aligned(here, opening, run.steering.options.gate)
        if self._passing and gets_in(run, opening, target):
            run.leg.enter(here.ring, target, run.now)
        self._turn = nearest(difference(opening.angle, here.theta), self._turn)
        return self._steer(target)

    def _steer(self, target: int) -> Status:
        """Command the plate, unless the state is too far from what the policy knows."""
        run, opening, policy = self.context, self.current_opening(), self.context.policy
        if policy is None:
            raise self.wrong("the run has no policy; --policy DIR gives it one")
        ring = run.maze.ring(self._ring)
        if ring.is_disc:
            return self.fail_as(FailureKind.UNFAMILIAR, "a policy knows channels, not the disc")
        inputs = policy_inputs(run.here, ring, opening, self._turn, self._passing, run.plate)
        distance = policy.distance(inputs)
        if not distance <= self.get("max_distance"):  # also where it is no number
            return self.fail_as(FailureKind.UNFAMILIAR, f"distance {distance:.2f} on the way to {opening.name}")
        run.log_law("policy")
        run.steer(self.name, policy.command(inputs, run.plate))
        return Status.RUNNING


def check_policy(tree: BehaviorTree, policy: Policy | None) -> None:
    """Raises InputError if the tree follows a policy but the run has none, or if the run has one but the tree follows
    none."""
    follows = any(isinstance(node, FollowPolicy) for node in tree.nodes())
    if follows and policy is None:
        raise InputError("the tree follows a learned policy, but the run has none: give --policy DIR")
    if policy is not None and not follows:
        raise InputError(f"--policy: the tree has no {FollowPolicy.__name__}; expected `policy`, or a tree that has")
