// BoxFDDP of crocoddyl with a compiled action model: dynamics and cost are the planner's own compiled functions.

#include <crocoddyl/core/action-base.hpp>
#include <crocoddyl/core/optctrl/shooting.hpp>
#include <crocoddyl/core/solvers/box-fddp.hpp>
#include <crocoddyl/core/states/euclidean.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "problem.hpp"

namespace {

using Eigen::VectorXd;
using Vector = Eigen::Ref<const VectorXd>;
using ByRows = Eigen::Matrix<double, N, N, Eigen::RowMajor>;

constexpr double REGULARISED = 1e-6;  // more than this is worth naming, as in the planner

class Step : public crocoddyl::ActionModelAbstract {
  using Data = std::shared_ptr<crocoddyl::ActionDataAbstract>;
  const Model &model;
  const int64_t number;

 public:
  Step(const Model &model, int64_t number)
      : crocoddyl::ActionModelAbstract(std::make_shared<crocoddyl::StateVector>(N), M, 0),
        model(model),
        number(number) {
    set_u_lb(VectorXd::Constant(M, -model.limit));
    set_u_ub(VectorXd::Constant(M, model.limit));
  }

  void calc(const Data &data, const Vector &x, const Vector &u) override {
    model.next(x.data(), u.data(), data->xnext.data());
    data->cost = model.cost(number, x.data(), u.data());
  }

  void calc(const Data &data, const Vector &x) override { data->cost = model.last_cost(x.data()); }

  void calcDiff(const Data &data, const Vector &x, const Vector &u) override {
    double next[N];
    ByRows A;
    Eigen::Matrix<double, N, M, Eigen::RowMajor> B;
    model.slopes(x.data(), u.data(), next, A.data(), B.data());
    data->Fx = A;
    data->Fu = B;  // the second derivatives of the cost are symmetric, so that their order does not matter
    model.cost_slopes(number, x.data(), u.data(), data->Lx.data(), data->Lu.data(), data->Lxx.data(),
                      data->Luu.data());
  }

  // asked for by crocoddyl 3.2, and never called here
  std::shared_ptr<crocoddyl::ActionModelBase> cloneAsDouble() const override { return nullptr; }
  std::shared_ptr<crocoddyl::ActionModelBase> cloneAsFloat() const override { return nullptr; }

  void calcDiff(const Data &data, const Vector &x) override {
    model.last_slopes(x.data(), data->Lx.data(), data->Lxx.data());
  }
};

// Ends a solve by the planner's rules, where crocoddyl knows an absolute bound alone.
class Ending : public crocoddyl::CallbackAbstract {
  const Rules &rules;
  std::vector<double> costs;

 public:
  explicit Ending(const Rules &rules) : rules(rules) {}
  void begin() { costs.clear(); }
  void operator()(crocoddyl::SolverAbstract &solver) override {
    const double cost = solver.get_cost(), small = rules.tolerance * (1.0 + std::abs(cost));
    costs.push_back(cost);
    const std::size_t n = costs.size(), back = static_cast<std::size_t>(rules.patience);
    const bool plain = solver.get_is_feasible() && solver.get_preg() <= REGULARISED;
    const bool stalls = plain && n > back && std::abs(costs[n - 1 - back] - cost) < small;
    solver.set_th_stop(stalls ? std::numeric_limits<double>::infinity() : small);
  }
};

struct Solver {
  const Model &model;
  const Rules &rules;
  std::shared_ptr<crocoddyl::ShootingProblem> problem;
  std::unique_ptr<crocoddyl::SolverBoxFDDP> solver;
  std::shared_ptr<Ending> ending;
  std::vector<VectorXd> xs, us;

  Solver(const Model &model, const Rules &rules)
      : model(model), rules(rules), xs(model.horizon + 1, VectorXd::Zero(N)), us(model.horizon, VectorXd::Zero(M)) {
    std::vector<std::shared_ptr<crocoddyl::ActionModelAbstract>> steps;
    for (int64_t t = 0; t <= model.horizon; ++t) steps.push_back(std::make_shared<Step>(model, t));
    const auto last = steps.back();
    steps.pop_back();
    problem = std::make_shared<crocoddyl::ShootingProblem>(VectorXd::Zero(N), steps, last);
    problem->set_nthreads(1);  // as the planner; and the dynamics keep scratch numbers behind their parameters
    solver = std::make_unique<crocoddyl::SolverBoxFDDP>(problem);
    ending = std::make_shared<Ending>(rules);
    solver->setCallbacks({ending});
  }
};

}  // namespace

// model and rules are the caller's and must outlive the solver.
extern "C" void *make(const Model *model, const Rules *rules) { return new Solver(*model, *rules); }

extern "C" void unmake(void *solver) { delete static_cast<Solver *>(solver); }

extern "C" void solve(void *handle, Trajectory *path) {
  Solver &s = *static_cast<Solver *>(handle);
  const Clock clock;
  prepare(s.model, *path);
  for (int64_t t = 0; t < s.model.horizon; ++t) {
    s.xs[t] = Eigen::Map<const VectorXd>(path->states + N * t, N);
    s.us[t] = Eigen::Map<const VectorXd>(path->controls + M * t, M);
  }
  s.xs.back() = Eigen::Map<const VectorXd>(path->states + N * s.model.horizon, N);
  s.problem->set_x0(s.xs.front());
  s.ending->begin();
  s.solver->set_th_stop(std::numeric_limits<double>::min());
  try {
    path->converged = s.solver->solve(s.xs, s.us, static_cast<std::size_t>(s.rules.iterations), path->kind != TAKE);
  } catch (const std::exception &) {
    path->converged = 0;
  }
  path->iterations = std::min(static_cast<int64_t>(s.solver->get_iter()) + 1, s.rules.iterations);
  for (int64_t t = 0; t < s.model.horizon; ++t) {
    Eigen::Map<VectorXd>(path->states + N * t, N) = s.solver->get_xs()[t];
    Eigen::Map<VectorXd>(path->controls + M * t, M) = s.solver->get_us()[t];
  }
  Eigen::Map<VectorXd>(path->states + N * s.model.horizon, N) = s.solver->get_xs().back();
  path->ms = clock.ms();
  path->qp_ms = 0.0;
}
