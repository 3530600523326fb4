"""Other solvers on the planner's problems, compiled with the planner's own functions: they must find its minimum."""

import bench_solver as bench
import bench_solver_rows as rows
import numpy as np
import pytest
from bench_solver_crocoddyl import box_fddp_library
from bench_solver_native import NativeSolver, compiled
from bench_solver_sqp import sqp_library
from bench_solver_starts import EFFECTS, GUESS, LEVEL, WARM, start_of, tasks_of

from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map

LIBRARIES = {rows.FDDP: box_fddp_library, rows.SQP: sqp_library}
NEAR = 0.01  # of the cost


@pytest.fixture(scope="module")
def planner():
    return bench.planner_of(load_map("cme"), load_model("toy"), bench.MEASURED)


@pytest.fixture(scope="module")
def tasks(planner):
    disturbances = bench.DISTURBANCE * np.random.default_rng(0).standard_normal((1, 1, 6))
    return list(tasks_of(planner, [tuple(bench.cases(1, 100)[0])], disturbances))


@pytest.fixture(params=list(LIBRARIES))
def solver(request, planner):
    try:
        library = LIBRARIES[request.param]()
    except ImportError as problem:
        pytest.skip(f"{request.param}: {problem}")
    native = NativeSolver(library, planner.dynamics, planner.tilt_limit, planner.options, 500)
    yield native
    native.close()


def cost_of(planner, task, answer):
    assert np.abs(answer.controls).max() <= planner.tilt_limit
    return rows.problem_of(planner, task.s0, task.goal).roll_out(answer.controls)[0]


@pytest.mark.parametrize("start", [LEVEL, GUESS, EFFECTS])
def test_a_compiled_solver_finds_the_minimum_of_the_planner(planner, tasks, solver, start):
    task = tasks[0]
    answer = solver.solve(task.s0, planner.cost.pack(task.goal), start_of(planner, task, start))
    assert answer.converged
    assert answer.ms > 0.0
    assert answer.iterations > 1
    assert cost_of(planner, task, answer) == pytest.approx(task.plan.cost, rel=NEAR)


def test_a_former_plan_is_improved(planner, tasks, solver):
    cold, task = tasks
    answer = solver.solve(task.s0, planner.cost.pack(task.goal), start_of(planner, task, WARM))
    assert answer.converged
    assert cost_of(planner, task, answer) == pytest.approx(task.plan.cost, rel=NEAR)
    assert start_of(planner, cold, WARM) is None


def test_a_single_step_on_a_former_plan_comes_near(planner, tasks):
    try:
        library = sqp_library()
    except ImportError as problem:
        pytest.skip(str(problem))
    task, native = tasks[1], NativeSolver(library, planner.dynamics, planner.tilt_limit, planner.options, 500)
    start = start_of(planner, task, WARM, feasible=False)
    answer = native.solve(task.s0, planner.cost.pack(task.goal), start, entry="step_once")
    native.close()
    assert 0.0 < answer.qp_ms < answer.ms
    assert cost_of(planner, task, answer) == pytest.approx(task.plan.cost, rel=NEAR)


def test_a_former_plan_is_followed_with_its_gains_as_the_planner_follows_it(planner, tasks):
    try:
        library = sqp_library()
    except ImportError as problem:
        pytest.skip(str(problem))
    task, wide = tasks[1], IlqgOptions(horizon=bench.HORIZON, tolerance=1e6)  # so wide that the start is the answer
    native = NativeSolver(library, planner.dynamics, planner.tilt_limit, wide, 500)
    start = start_of(planner, task, WARM)
    answer = native.solve(task.s0, planner.cost.pack(task.goal), start)
    native.close()
    s, p, wished = task.s0.copy(), np.array(planner.dynamics.parameters, dtype=float), []
    for u, K, reference in zip(start.controls, start.gains, start.states, strict=False):
        wished.append(np.clip(u + K @ (s - reference), -planner.tilt_limit, planner.tilt_limit))
        after = np.empty(6)
        planner.dynamics.step(s, wished[-1], p, after)
        s = after
    assert np.abs(np.array(wished) - start.controls).max() > 1e-4
    np.testing.assert_allclose(answer.controls, wished, atol=1e-12)


def test_what_cannot_be_compiled_is_told_in_a_line(tmp_path, monkeypatch):
    monkeypatch.setattr("bench_solver_native.SOURCES", tmp_path)
    monkeypatch.setattr("bench_solver_native.BUILT", tmp_path / "built")
    (tmp_path / "problem.hpp").write_text("")
    (tmp_path / "wrong.cpp").write_text("int f( {")
    with pytest.raises(ImportError, match=r"g\+\+|wrong.cpp cannot be compiled: .*error"):
        compiled("wrong.cpp", ())
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ImportError, match=r"no C\+\+ compiler"):
        compiled("other.cpp", ())


def test_without_other_solvers_the_table_has_the_planner_and_what_is_missing(planner, monkeypatch):
    def missing():
        raise ModuleNotFoundError("No module named 'crocoddyl'", name="crocoddyl")

    monkeypatch.setattr(rows, "SOLVERS", {"BoxFDDP": lambda problem: missing()})
    for name in ("box_fddp_library", "sqp_library"):
        monkeypatch.setattr(rows, name, missing)
    lines = rows.other_rows(planner, [tuple(bench.cases(1, 100)[0])], np.zeros((1, 1, 6)))
    assert sum(line.startswith("| iLQG |") for line in lines) == 4  # from level and guess alone, and cold and warm
    assert "Left out: SQP (HPIPM), compiled (crocoddyl is not installed)." in lines
    assert "Left out: BoxFDDP (crocoddyl is not installed)." in lines


def test_there_is_no_plan_on_the_effects_without_a_process(planner, tasks):
    without = RingPlanner(planner.parameters, planner.tilt_limit, planner.options)
    assert start_of(without, tasks[0], EFFECTS) is None
