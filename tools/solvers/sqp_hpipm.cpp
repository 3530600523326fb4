// Sequential quadratic programming by multiple shooting, its quadratic problems solved by HPIPM.
//
// The second derivatives are those of the cost alone (Gauss-Newton), as in the planner. Steps are full ones where the
// merit function, cost + sum weight |gap|, falls by enough, else shorter; where none does, the second derivatives by
// the controls are raised. Each gap has a weight of its own, from its multiplier (Powell, 1978); with one weight for
// all of them steps were a tenth as long. A filter was faster on some problems, and went in circles on others. One step
// without any of that is what real-time iterations make each tick.

#include <hpipm_d_ocp_qp.h>
#include <hpipm_d_ocp_qp_dim.h>
#include <hpipm_d_ocp_qp_ipm.h>
#include <hpipm_d_ocp_qp_sol.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "problem.hpp"

namespace {

constexpr double MIN_RATIO = 1e-4, SHORTER = 0.4;  // as the planner's
constexpr double DAMPING_MIN = 1e-6, DAMPING_MAX = 1e10, DAMPING_FACTOR = 8.0;
constexpr double QP_TOLERANCE = 1e-6, QP_BARRIER = 0.1;  // the first barrier; a third faster than with HPIPM's own
constexpr int TRIES = 8;

using Numbers = std::vector<double>;

// Memory that HPIPM lays one of its structures out in.
class Memory {
  std::unique_ptr<char[]> bytes;

 public:
  void *take(std::size_t size) {
    bytes.reset(new char[size + 64]());
    return bytes.get();
  }
};

struct Solver {
  const Model &model;
  const Rules &rules;
  const int T;
  Memory memory[5];
  d_ocp_qp_dim dim;
  d_ocp_qp qp;
  d_ocp_qp_sol sol;
  d_ocp_qp_ipm_arg arg;
  d_ocp_qp_ipm_ws work;
  Numbers x, u, next, A, B, lx, lu, lxx, luu;           // the trajectory and its derivatives
  Numbers new_x, new_u, new_next, new_A, new_B, dx, du;  // a candidate
  Numbers weights;                                      // of the gaps
  double qp_ms = 0.0;

  Solver(const Model &model, const Rules &rules) : model(model), rules(rules), T(static_cast<int>(model.horizon)) {
    for (Numbers *v : {&x, &next, &lx, &new_x, &new_next, &dx}) v->resize(N * (T + 1));
    weights.resize(N * T);
    for (Numbers *v : {&u, &lu, &new_u, &du}) v->resize(M * T);
    for (Numbers *v : {&A, &new_A}) v->resize(N * N * T);
    for (Numbers *v : {&B, &new_B}) v->resize(N * M * T);
    lxx.resize(N * N * (T + 1));
    luu.resize(M * M * T);
    lay_out();
  }

  void lay_out() {
    d_ocp_qp_dim_create(T, &dim, memory[0].take(d_ocp_qp_dim_memsize(T)));
    for (int t = 0; t <= T; ++t) {
      d_ocp_qp_dim_set_nx(t, t ? N : 0, &dim);  // the first state is given
      d_ocp_qp_dim_set_nu(t, t < T ? M : 0, &dim);
      d_ocp_qp_dim_set_nbx(t, 0, &dim);
      d_ocp_qp_dim_set_nbu(t, t < T ? M : 0, &dim);
      d_ocp_qp_dim_set_ng(t, 0, &dim);
      d_ocp_qp_dim_set_ns(t, 0, &dim);
    }
    d_ocp_qp_create(&dim, &qp, memory[1].take(d_ocp_qp_memsize(&dim)));
    d_ocp_qp_set_all_zero(&qp);
    d_ocp_qp_sol_create(&dim, &sol, memory[2].take(d_ocp_qp_sol_memsize(&dim)));
    d_ocp_qp_ipm_arg_create(&dim, &arg, memory[3].take(d_ocp_qp_ipm_arg_memsize(&dim)));
    d_ocp_qp_ipm_arg_set_default(SPEED, &arg);
    double tolerance = QP_TOLERANCE, barrier = QP_BARRIER;
    d_ocp_qp_ipm_arg_set_tol_stat(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_eq(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_ineq(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_comp(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_mu0(&barrier, &arg);
    int most = 50;
    d_ocp_qp_ipm_arg_set_iter_max(&most, &arg);
    d_ocp_qp_ipm_ws_create(&dim, &arg, &work, memory[4].take(d_ocp_qp_ipm_ws_memsize(&dim, &arg)));
    int both[M] = {0, 1};
    for (int t = 0; t < T; ++t) d_ocp_qp_set_idxbu(t, both, &qp);
  }

  // Steps and cost along states and controls; with slopes the steps are linearised, too.
  double along(const Numbers &states, const Numbers &controls, Numbers &after, double *As, double *Bs) const {
    double total = 0.0;
    for (int t = 0; t < T; ++t) {
      const double *s = &states[N * t], *c = &controls[M * t];
      total += model.cost(t, s, c);
      if (As)
        model.slopes(s, c, &after[N * t], As + N * N * t, Bs + N * M * t);
      else
        model.next(s, c, &after[N * t]);
    }
    return total + model.last_cost(&states[N * T]);
  }

  double gaps(const Numbers &states, const Numbers &after) const {
    double total = 0.0;
    for (int i = 0; i < N * T; ++i) total += weights[i] * std::abs(after[i] - states[i + N]);
    return total;
  }

  void cost_slopes() {
    for (int t = 0; t < T; ++t)
      model.cost_slopes(t, &x[N * t], &u[M * t], &lx[N * t], &lu[M * t], &lxx[N * N * t], &luu[M * M * t]);
    model.last_slopes(&x[N * T], &lx[N * T], &lxx[N * N * T]);
  }

  // The quadratic problem of the corrections: dx, du. Whether HPIPM solved it.
  bool correct(double damping) {
    const Clock clock;
    for (int t = 0; t <= T; ++t) {
      if (t) {
        d_ocp_qp_set_Q(t, &lxx[N * N * t], &qp);
        d_ocp_qp_set_q(t, &lx[N * t], &qp);
      }
      if (t == T) break;
      double by_columns[N * N], gap[N], R[M * M], low[M], high[M];
      for (int i = 0; i < N; ++i) {
        for (int j = 0; j < N; ++j) by_columns[N * j + i] = A[N * N * t + N * i + j];
        gap[i] = next[N * t + i] - x[N * (t + 1) + i];
      }
      if (t) d_ocp_qp_set_A(t, by_columns, &qp);
      for (int i = 0; i < N; ++i)
        for (int j = 0; j < M; ++j) by_columns[N * j + i] = B[N * M * t + M * i + j];
      d_ocp_qp_set_B(t, by_columns, &qp);
      d_ocp_qp_set_b(t, gap, &qp);
      for (int i = 0; i < M * M; ++i) R[i] = luu[M * M * t + i] + (i % (M + 1) ? 0.0 : damping);
      for (int i = 0; i < M; ++i) {
        low[i] = -model.limit - u[M * t + i];
        high[i] = model.limit - u[M * t + i];
      }
      d_ocp_qp_set_R(t, R, &qp);
      d_ocp_qp_set_r(t, &lu[M * t], &qp);
      d_ocp_qp_set_lbu(t, low, &qp);
      d_ocp_qp_set_ubu(t, high, &qp);
    }
    d_ocp_qp_ipm_solve(&qp, &sol, &arg, &work);
    int status;
    d_ocp_qp_ipm_get_status(&work, &status);
    for (int i = 0; i < N; ++i) dx[i] = 0.0;
    for (int t = 0; t <= T; ++t) {
      if (t) d_ocp_qp_sol_get_x(t, &sol, &dx[N * t]);
      if (t < T) d_ocp_qp_sol_get_u(t, &sol, &du[M * t]);
    }
    qp_ms += clock.ms();
    double sum = 0.0;
    for (double v : du) sum += v;
    return status != 3 && std::isfinite(sum);  // 1 and 2: not as exact as asked, which the merit function judges
  }

  // Weights of the gaps: their multipliers, and where these fall half of what was.
  void weigh() {
    double pi[N];
    for (int t = 0; t < T; ++t) {
      d_ocp_qp_sol_get_pi(t, &sol, pi);
      for (int i = 0; i < N; ++i) {
        double &weight = weights[N * t + i];
        weight = std::max(std::abs(pi[i]), 0.5 * (weight + std::abs(pi[i])));
      }
    }
  }

  // Slope and curvature of the cost along the correction.
  void foretell(double &slope, double &curvature) const {
    slope = curvature = 0.0;
    for (int t = 0; t <= T; ++t) {
      for (int i = 0; i < N; ++i) {
        slope += lx[N * t + i] * dx[N * t + i];
        for (int j = 0; j < N; ++j) curvature += 0.5 * dx[N * t + i] * lxx[N * N * t + N * i + j] * dx[N * t + j];
      }
      for (int i = 0; t < T && i < M; ++i) {
        slope += lu[M * t + i] * du[M * t + i];
        for (int j = 0; j < M; ++j) curvature += 0.5 * du[M * t + i] * luu[M * M * t + M * i + j] * du[M * t + j];
      }
    }
  }

  void candidate(double alpha) {
    for (int i = 0; i < N * (T + 1); ++i) new_x[i] = x[i] + alpha * dx[i];
    for (int i = 0; i < M * T; ++i) new_u[i] = model.inside(u[i] + alpha * du[i]);
  }

  // The longest step that lowers cost + sum weight |gap| by enough, if there is one; else the damping is raised.
  bool search(double &cost, double slope, double &damping) {
    const double priced = gaps(x, next), fall = MIN_RATIO * std::min(slope - priced, 0.0);
    double alpha = 1.0;
    for (int n = 0; n < TRIES; ++n, alpha *= SHORTER) {
      candidate(alpha);
      const double c = along(new_x, new_u, new_next, n ? nullptr : new_A.data(), new_B.data());
      if (!(c + gaps(new_x, new_next) <= cost + priced + alpha * fall)) continue;
      if (n) along(new_x, new_u, new_next, new_A.data(), new_B.data());
      x.swap(new_x);
      u.swap(new_u);
      next.swap(new_next);
      A.swap(new_A);
      B.swap(new_B);
      cost = c;
      if (!n) damping = damping / DAMPING_FACTOR < DAMPING_MIN ? 0.0 : damping / DAMPING_FACTOR;
      return true;
    }
    damping = std::max(DAMPING_MIN, damping) * DAMPING_FACTOR;
    return false;
  }

  // Whether the rules call the trajectory solved, then how many iterations that took.
  bool improve(int64_t &done) {
    double damping = 0.0, cost = along(x, u, next, A.data(), B.data());
    Numbers costs;
    std::fill(weights.begin(), weights.end(), 0.0);
    for (done = 0; done < rules.iterations && std::isfinite(cost); ++done) {
      cost_slopes();
      if (!correct(damping)) return false;
      weigh();
      double slope, curvature;
      foretell(slope, curvature);
      const double small = rules.tolerance * (1.0 + std::abs(cost));
      const bool closed = gaps(x, next) < small && damping <= DAMPING_MIN;
      if (closed && std::abs(slope + curvature) < small) return ++done, true;
      if (!search(cost, slope, damping) && damping > DAMPING_MAX) return false;
      costs.push_back(cost);
      const auto n = static_cast<int64_t>(costs.size());
      if (closed && n > rules.patience && std::abs(costs[n - 1 - rules.patience] - cost) < small) return ++done, true;
    }
    return false;
  }

  // One full step, as real-time iterations make it.
  bool once() {
    along(x, u, next, A.data(), B.data());
    cost_slopes();
    if (!correct(0.0)) return false;
    candidate(1.0);
    x.swap(new_x);
    u.swap(new_u);
    return true;
  }

  void solve(Trajectory &path, bool single) {
    const Clock clock;
    prepare(model, path);
    std::memcpy(x.data(), path.states, sizeof(double) * x.size());
    std::memcpy(u.data(), path.controls, sizeof(double) * u.size());
    qp_ms = 0.0;
    path.iterations = 1;
    path.converged = single ? once() : improve(path.iterations);
    std::memcpy(path.states, x.data(), sizeof(double) * x.size());
    std::memcpy(path.controls, u.data(), sizeof(double) * u.size());
    path.ms = clock.ms();
    path.qp_ms = qp_ms;
  }
};

}  // namespace

// model and rules are the caller's and must outlive the solver.
extern "C" void *make(const Model *model, const Rules *rules) { return new Solver(*model, *rules); }

extern "C" void unmake(void *solver) { delete static_cast<Solver *>(solver); }

extern "C" void solve(void *solver, Trajectory *path) { static_cast<Solver *>(solver)->solve(*path, false); }

extern "C" void step_once(void *solver, Trajectory *path) { static_cast<Solver *>(solver)->solve(*path, true); }
