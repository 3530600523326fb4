"""The packaged leaves that a tree may name."""

from __future__ import annotations

from mazeplan.behavior.ball_leaves import BallsStay, ChooseBall, LeadBall
from mazeplan.behavior.follow_policy import FollowPolicy
from mazeplan.behavior.opening_leaves import Align, ConfirmRing, PassOpening, Settle
from mazeplan.behavior.recovery import (
    AvoidOpening,
    BackOff,
    BallSeen,
    Dither,
    FailureIs,
    InRing,
    LevelPlate,
    Replan,
)
from mazeplan.behavior.routing import ChooseOpening, PlanRoute
from mazeplan.behavior.travel import PlanInRing, Track
from mazeplan.btree.leaf import Leaf

REGISTRY: dict[str, type[Leaf]] = {
    leaf.__name__: leaf
    for leaf in (
        Align,
        AvoidOpening,
        BackOff,
        BallSeen,
        BallsStay,
        ChooseBall,
        ChooseOpening,
        ConfirmRing,
        Dither,
        FailureIs,
        FollowPolicy,
        InRing,
        LeadBall,
        LevelPlate,
        PassOpening,
        PlanInRing,
        PlanRoute,
        Replan,
        Settle,
        Track,
    )
}
