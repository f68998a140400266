#include "pose_graph/graph_problem.hpp"

#include <stillmap/maps/small_matrices.hpp>
#include "pose_graph/elimination_order.hpp"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cstddef>

namespace stillmap::mapping {
namespace {

/// A node among Ceres' parameters: qx qy qz qw tx ty tz.
using Parameters = std::array<double, 7>;
using JacobianMap = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 7, Eigen::RowMajor>>;

NodePose node_at(const double* parameters) {
  return {Eigen::Quaterniond(Eigen::Map<const Eigen::Vector4d>(parameters)),
          Eigen::Map<const Eigen::Vector3d>(parameters + 4)};
}

void store(const NodePose& node, double* parameters) {
  Eigen::Map<Eigen::Vector4d>{parameters} = node.q_map_node.coeffs();
  Eigen::Map<Eigen::Vector3d>{parameters + 4} = node.t_map_node;
}

}  // namespace

/// Steps of `NodePose`. Cost functions give their slope along the six of a step in the first six
/// columns, so the slope of the seven numbers themselves never needs to be known.
class NodeManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    store(node_at(x).moved(Eigen::Map<const Vector6d>(delta)), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>{jacobian}.setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    Eigen::Map<Vector6d>{y_minus_x} = node_at(x).step_to(node_at(y));
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>>{jacobian}.setIdentity();
    return true;
  }
};

namespace {

template <typename Whitening, typename Jacobian>
void write_jacobian(double* out, const Whitening& W, const Jacobian& J) {
  JacobianMap map(out, W.rows(), 7);
  map.leftCols<6>().noalias() = W * J;
  map.col(6).setZero();
}

class RelativeCost final : public ceres::SizedCostFunction<6, 7, 7> {
 public:
  explicit RelativeCost(const RelativePose& edge)
      : T_from_to_(node_pose(edge.T_from_to)),
        whitening_(maps::inverse_cholesky(edge.covariance)) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const RelativeResidual residual =
        relative_residual(node_at(parameters[0]), node_at(parameters[1]), T_from_to_);
    Eigen::Map<Vector6d>{residuals} = whitening_ * residual.value;
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) write_jacobian(jacobians[0], whitening_, residual.J_from);
    if (jacobians[1] != nullptr) write_jacobian(jacobians[1], whitening_, residual.J_to);
    return true;
  }

 private:
  NodePose T_from_to_;
  Matrix6d whitening_;
};

class AbsoluteCost final : public ceres::SizedCostFunction<6, 7> {
 public:
  explicit AbsoluteCost(const AbsolutePose& pose)
      : T_map_node_(node_pose(pose.T_map_node)),
        whitening_(maps::inverse_cholesky(pose.covariance)) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const AbsoluteResidual residual = absolute_residual(node_at(parameters[0]), T_map_node_);
    Eigen::Map<Vector6d>{residuals} = whitening_ * residual.value;
    if (jacobians != nullptr && jacobians[0] != nullptr)
      write_jacobian(jacobians[0], whitening_, residual.J);
    return true;
  }

 private:
  NodePose T_map_node_;
  Matrix6d whitening_;
};

class PositionCost final : public ceres::SizedCostFunction<3, 7> {
 public:
  explicit PositionCost(const AbsolutePosition& position)
      : position_map_m_(position.position_map_m),
        lever_node_m_(position.lever_node_m),
        whitening_(maps::inverse_cholesky(position.covariance)) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const PositionResidual residual =
        position_residual(node_at(parameters[0]), position_map_m_, lever_node_m_);
    Eigen::Map<Eigen::Vector3d>{residuals} = whitening_ * residual.value;
    if (jacobians != nullptr && jacobians[0] != nullptr)
      write_jacobian(jacobians[0], whitening_, residual.J);
    return true;
  }

 private:
  Eigen::Vector3d position_map_m_;
  Eigen::Vector3d lever_node_m_;
  Eigen::Matrix3d whitening_;
};

/// 99.9 % points of chi-squared with 6 and 3 degrees of freedom: noise seldom goes beyond.
constexpr double kPoseBound = 22.46;
constexpr double kPositionBound = 16.27;

}  // namespace

class GraduatedLoss final : public ceres::LossFunction {
 public:
  GraduatedLoss(double bound, const double& mu) : bound_(bound), mu_(mu) {}
  void Evaluate(double s, double* rho) const override {
    const double c = mu_ * bound_, share = c / (c + s);
    rho[0] = share * s;
    rho[1] = share * share;
    rho[2] = -2.0 * share * share / (c + s);
  }
  double weight(double s) const {
    double rho[3];
    Evaluate(s, rho);
    return rho[1];
  }
  double doubt(double s) const { return s / bound_; }

 private:
  double bound_;
  const double& mu_;
};

/// A measurement among Ceres' residuals, which owns the cost.
struct Measurement {
  const ceres::CostFunction* cost = nullptr;
  /// None when it is not doubtful.
  const GraduatedLoss* loss = nullptr;
  std::array<const double*, 2> nodes{};

  [[nodiscard]] double chi_squared() const {
    Vector6d residual = Vector6d::Zero();
    cost->Evaluate(nodes.data(), residual.data(), nullptr);
    return residual.squaredNorm();
  }
  [[nodiscard]] double weight() const {
    return loss == nullptr ? 1.0 : loss->weight(chi_squared());
  }
};

namespace {

std::vector<double> weights_of(const std::vector<Measurement>& measurements) {
  std::vector<double> out;
  out.reserve(measurements.size());
  for (const Measurement& measurement : measurements) out.push_back(measurement.weight());
  return out;
}

class StopWhenCancelled final : public ceres::IterationCallback {
 public:
  explicit StopWhenCancelled(const CancelFlag& cancel) : cancel_(cancel) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*summary*/) override {
    return cancel_ ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  const CancelFlag& cancel_;
};

ceres::Problem::Options problem_options() {
  ceres::Problem::Options options;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

/// From so many nodes on CHOLMOD multiplies by whole blocks, in the order of nested dissection;
/// below, Eigen is as fast, and its bits do not depend on which BLAS is installed.
constexpr std::size_t kLargeGraph = 30'000;

ceres::Solver::Options solver_options() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  // Ceres adds up costs and gradients in the order in which its threads come; evaluation is a
  // small part of the time.
  options.num_threads = 1;
  options.initial_trust_region_radius = 1e6;
  // What nothing measures (the turn about a straight line of positions) must not move: some damping
  // stays.
  options.max_trust_region_radius = 1e12;
  options.gradient_tolerance = 1e-12;
  options.parameter_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  return options;
}

}  // namespace

struct GraphProblem::State {
  std::vector<Parameters> nodes;
  double mu = 1.0;
  NodeManifold manifold;
  GraduatedLoss pose_loss{kPoseBound, mu};
  GraduatedLoss position_loss{kPositionBound, mu};
  std::vector<Measurement> relative_poses;
  std::vector<Measurement> absolute_poses;
  std::vector<Measurement> positions;
  /// Of a large graph: the order in which its nodes are eliminated.
  std::vector<std::size_t> order;
  ceres::Problem problem{problem_options()};

  template <typename... Nodes>
  Measurement add(ceres::CostFunction* cost, GraduatedLoss* loss, Nodes... indices) {
    problem.AddResidualBlock(cost, loss, nodes[indices].data()...);
    return {cost, loss, {nodes[indices].data()...}};
  }
};

GraphProblem::GraphProblem(const PoseGraph& graph, const std::vector<Eigen::Isometry3d>& start)
    : state_(std::make_unique<State>()) {
  State& state = *state_;
  state.nodes.resize(graph.nodes.size());
  for (std::size_t i = 0; i < graph.nodes.size(); ++i) {
    store(node_pose(start[i]), state.nodes[i].data());
    state.problem.AddParameterBlock(state.nodes[i].data(), 7, &state.manifold);
  }
  for (const RelativePose& edge : graph.relative_poses)
    state.relative_poses.push_back(state.add(
        new RelativeCost(edge), edge.doubtful ? &state.pose_loss : nullptr, edge.from, edge.to));
  for (const AbsolutePose& pose : graph.absolute_poses)
    state.absolute_poses.push_back(
        state.add(new AbsoluteCost(pose), pose.doubtful ? &state.pose_loss : nullptr, pose.node));
  for (const AbsolutePosition& position : graph.absolute_positions)
    state.positions.push_back(state.add(new PositionCost(position),
                                        position.doubtful ? &state.position_loss : nullptr,
                                        position.node));
  if (graph.absolute_poses.empty() && graph.absolute_positions.empty() && !graph.nodes.empty())
    state.problem.SetParameterBlockConstant(state.nodes.front().data());
  if (graph.nodes.size() >= kLargeGraph) state.order = elimination_order(graph);
}

GraphProblem::~GraphProblem() = default;

GraphProblem::Outcome GraphProblem::minimize(int max_iterations, double cost_tolerance,
                                             const CancelFlag& cancel) {
  ceres::Solver::Options options = solver_options();
  options.max_num_iterations = max_iterations;
  options.function_tolerance = cost_tolerance;
  if (!state_->order.empty()) {
    options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (std::size_t i = 0; i < state_->order.size(); ++i)
      options.linear_solver_ordering->AddElementToGroup(state_->nodes[state_->order[i]].data(),
                                                        static_cast<int>(i));
  }
  StopWhenCancelled stop(cancel);
  options.callbacks.push_back(&stop);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &state_->problem, &summary);
  if (cancel) throw Cancelled();
  // The first of Ceres' iterations is the starting point.
  const int steps = summary.num_successful_steps + summary.num_unsuccessful_steps - 1;
  return {std::max(steps, 0), summary.termination_type == ceres::CONVERGENCE};
}

void GraphProblem::set_mu(double mu) { state_->mu = mu; }

double GraphProblem::worst_doubt() const {
  double out = 0.0;
  for (const std::vector<Measurement>* list :
       {&state_->relative_poses, &state_->absolute_poses, &state_->positions}) {
    for (const Measurement& measurement : *list) {
      if (measurement.loss == nullptr) continue;
      out = std::max(out, measurement.loss->doubt(measurement.chi_squared()));
    }
  }
  return out;
}

std::vector<double> GraphProblem::relative_weights() const {
  return weights_of(state_->relative_poses);
}

std::vector<double> GraphProblem::absolute_weights() const {
  return weights_of(state_->absolute_poses);
}

std::vector<double> GraphProblem::position_weights() const { return weights_of(state_->positions); }

double GraphProblem::cost() const {
  double out = 0.0;
  for (const std::vector<Measurement>* list :
       {&state_->relative_poses, &state_->absolute_poses, &state_->positions})
    for (const Measurement& measurement : *list)
      out += measurement.weight() * measurement.chi_squared();
  return out;
}

std::vector<Eigen::Isometry3d> GraphProblem::nodes() const {
  std::vector<Eigen::Isometry3d> out;
  out.reserve(state_->nodes.size());
  for (const Parameters& node : state_->nodes) out.push_back(isometry(node_at(node.data())));
  return out;
}

}  // namespace stillmap::mapping
