"""Soft actor-critic (Stable-Baselines3) learns to bring the ball to the centre, from nothing.

    pip install stable-baselines3
    python examples/sac.py --from 4 --steps 60000

Before and after, the policy plays the same episodes without exploring. From ring 4 on the rig `toy` 60,000 steps (9
minutes on two busy cores) took it from 0 of 10 arrived to 10 of 10, in 1.7 s of the rig's time (seed 0); the planner of
`navigate` takes 1.1 s. From ring 1 it takes far more: nothing here is tuned.

The reward is shaped with discount 1, so that what a step is worth is the time to the goal that it saves, and it is
scaled. With the learner's own discount standing still costs a little everywhere, most beside the goal: so shaped, and
not scaled, 60,000 steps did not bring the ball in once.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

try:
    from stable_baselines3 import SAC
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecEnv, VecNormalize

    import mazeplan.apps.environment as room
    from mazeplan.core.errors import MazeplanError
except ImportError as missing:
    sys.exit(f"examples/sac.py needs {missing.name}: pip install stable-baselines3, and mazeplan with its extra gym")

EPISODES = 10  # of a trial
TRIAL_SEED = 10_000  # far from those of training


def trial(model: BaseAlgorithm, env: VecEnv) -> str:
    """What the policy reaches without exploring: a line for people. env: with one environment in it."""
    arrived, returns, times = 0, [], []
    for episode in range(EPISODES):
        env.seed(TRIAL_SEED + episode)
        observation, done, total, told = env.reset(), False, 0.0, {}
        while not done:
            action, _ = model.predict(observation, deterministic=True)  # pyright: ignore[reportArgumentType]
            observation, reward, ended, infos = env.step(action)
            done, told = bool(ended[0]), infos[0]
            total += float(reward[0])
        returns.append(total)
        arrived += told["success"]
        times += [told["time_s"]] if told["success"] else []
    mean = f", in {sum(times) / len(times):.2f} s on average" if times else ""
    return f"{arrived} of {EPISODES} arrived{mean}; mean return {sum(returns) / EPISODES:.2f}"


def main() -> None:
    """Train and try."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=60_000, help="samples of experience; 30 are a second of the rig")
    parser.add_argument("--from", dest="start", default="any", help="ring to start in, or any")
    parser.add_argument("--rig", default="toy")
    parser.add_argument("--discount", type=float, default=0.98, help="of the learner")
    parser.add_argument("--environments", type=int, default=4, help="that gather experience side by side")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, help="file for the policy, .zip")
    given = parser.parse_args()
    if given.steps < 1 or given.environments < 1:
        parser.error("--steps, --environments: expected a number above 0")
    options = {"rig": given.rig, "reward": "dense", "start_ring": given.start, "discount": 1.0}
    env = make_vec_env(room.ID, given.environments, seed=given.seed, env_kwargs=options)
    env = VecNormalize(env, norm_obs=False, norm_reward=True, gamma=given.discount)  # all of an episode's is below 1
    alone = make_vec_env(room.ID, 1, env_kwargs=options)
    model = SAC(
        "MlpPolicy", env, gamma=given.discount, seed=given.seed, learning_starts=1000, batch_size=128,
        train_freq=8, gradient_steps=-1, device="cpu",
        use_sde=True, sde_sample_freq=8,  # noise that changes with each sample never gets past the servos
        policy_kwargs={"net_arch": [128, 128]},
    )  # fmt: skip
    print("before:", trial(model, alone), flush=True)
    began = time.monotonic()
    model.learn(given.steps, log_interval=None)
    print(f"after {given.steps} steps, {time.monotonic() - began:.0f} s:", trial(model, alone), flush=True)
    if given.output is not None:
        model.save(given.output)


if __name__ == "__main__":
    try:
        main()
    except MazeplanError as problem:
        sys.exit(f"examples/sac.py: {problem}")
