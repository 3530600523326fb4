// What the compiled solvers share: the planner's dynamics and cost behind plain pointers, and where a solve starts.
//
// The functions themselves are those that the planner calls, at the addresses at which it calls them. Each is reached
// through a small C function made by Numba (tools/bench_solver_native.py), which takes the address first.
#pragma once

#include <chrono>
#include <cstdint>

constexpr int N = 6, M = 2;  // states and controls

struct Model {
  void (*step)(int64_t, const double *s, const double *u, double *p, int64_t size, double *out);
  void (*linearise)(int64_t, const double *s, const double *u, double *p, int64_t size, double *out, double *A,
                    double *B);
  double (*running)(int64_t, int64_t k, const double *s, const double *u, const double *q, int64_t size);
  void (*running_derivatives)(int64_t, int64_t k, const double *s, const double *u, const double *q, int64_t size,
                              double *lx, double *lu, double *lxx, double *luu);
  double (*final)(int64_t, const double *s, const double *q, int64_t size);
  void (*final_derivatives)(int64_t, const double *s, const double *q, int64_t size, double *lx, double *lxx);
  int64_t at_step, at_linearise, at_running, at_running_derivatives, at_final, at_final_derivatives;
  double *p;  // of the dynamics
  int64_t p_size;
  const double *q;  // of the cost
  int64_t q_size;
  double limit;  // of the commands, rad
  int64_t horizon;

  void next(const double *s, const double *u, double *out) const { step(at_step, s, u, p, p_size, out); }
  void slopes(const double *s, const double *u, double *out, double *A, double *B) const {
    linearise(at_linearise, s, u, p, p_size, out, A, B);  // A (6, 6) and B (6, 2) by rows
  }
  double cost(int64_t k, const double *s, const double *u) const { return running(at_running, k, s, u, q, q_size); }
  void cost_slopes(int64_t k, const double *s, const double *u, double *lx, double *lu, double *lxx,
                   double *luu) const {
    running_derivatives(at_running_derivatives, k, s, u, q, q_size, lx, lu, lxx, luu);
  }
  double last_cost(const double *s) const { return final(at_final, s, q, q_size); }
  void last_slopes(const double *s, double *lx, double *lxx) const {
    final_derivatives(at_final_derivatives, s, q, q_size, lx, lxx);
  }
  double inside(double u) const { return u < -limit ? -limit : u > limit ? limit : u; }
};

// Rules of stopping, those of the planner: a share of 1 + |cost|, and iterations that together get no more than it.
struct Rules {
  double tolerance;
  int64_t patience, iterations;
};

// Where a solve starts, and then what it found. ROLL_OUT: controls from the first state; FOLLOW: controls with the
// gains around the states, as the planner follows a former plan on; TAKE: states and controls as they are.
enum Kind : int64_t { ROLL_OUT = 0, FOLLOW = 1, TAKE = 2 };

struct Trajectory {
  int64_t kind;
  const double *s0;     // (6,)
  double *states;       // (T + 1, 6)
  double *controls;     // (T, 2)
  const double *gains;  // (T, 2, 6)
  double ms, qp_ms;     // of the solve, and of the quadratic problems inside it
  int64_t iterations, converged;
};

class Clock {
  std::chrono::steady_clock::time_point began = std::chrono::steady_clock::now();

 public:
  double ms() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count();
  }
};

// Bring states and controls of a trajectory together where its kind asks for it.
inline void prepare(const Model &model, Trajectory &to) {
  double s[N];
  for (int i = 0; i < N; ++i) s[i] = to.s0[i];
  for (int64_t t = 0; t < model.horizon; ++t) {
    double *u = to.controls + M * t, *planned = to.states + N * t;
    for (int i = 0; i < M; ++i) {
      if (to.kind == FOLLOW)
        for (int j = 0; j < N; ++j) u[i] += to.gains[(M * t + i) * N + j] * (s[j] - planned[j]);
      u[i] = model.inside(u[i]);
    }
    if (to.kind == TAKE) continue;
    for (int i = 0; i < N; ++i) planned[i] = s[i];
    model.next(planned, u, s);
  }
  for (int i = 0; i < N; ++i)
    if (to.kind == TAKE)
      to.states[i] = to.s0[i];
    else
      to.states[N * model.horizon + i] = s[i];
}
