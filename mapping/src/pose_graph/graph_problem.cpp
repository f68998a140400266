#include "pose_graph/graph_problem.hpp"

#include <Eigen/Cholesky>

#include <ceres/ceres.h>

#include <array>
#include <cmath>

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

/// The inverse of the covariance's Cholesky factor: W^T W is the information.
template <typename Matrix>
Matrix whitening(const Matrix& covariance) {
  return Eigen::LLT<Matrix>(covariance).matrixL().solve(Matrix::Identity());
}

template <typename Whitening, typename Jacobian>
void write_jacobian(double* out, const Whitening& W, const Jacobian& J) {
  JacobianMap map(out, W.rows(), 7);
  map.leftCols<6>().noalias() = W * J;
  map.col(6).setZero();
}

class RelativeCost final : public ceres::SizedCostFunction<6, 7, 7> {
 public:
  RelativeCost(const RelativePose& edge, const double* weight)
      : T_from_to_(node_pose(edge.T_from_to)),
        whitening_(whitening(edge.covariance)),
        weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const RelativeResidual residual =
        relative_residual(node_at(parameters[0]), node_at(parameters[1]), T_from_to_);
    const Matrix6d W = std::sqrt(*weight_) * whitening_;
    Eigen::Map<Vector6d>{residuals} = W * residual.value;
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) write_jacobian(jacobians[0], W, residual.J_from);
    if (jacobians[1] != nullptr) write_jacobian(jacobians[1], W, residual.J_to);
    return true;
  }
  double chi_squared(const Parameters& from, const Parameters& to) const {
    return (whitening_ *
            relative_residual(node_at(from.data()), node_at(to.data()), T_from_to_).value)
        .squaredNorm();
  }

 private:
  NodePose T_from_to_;
  Matrix6d whitening_;
  const double* weight_;
};

class AbsoluteCost final : public ceres::SizedCostFunction<6, 7> {
 public:
  explicit AbsoluteCost(const AbsolutePose& pose)
      : T_map_node_(node_pose(pose.T_map_node)), whitening_(whitening(pose.covariance)) {}
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
  PositionCost(const AbsolutePosition& position, const double* weight)
      : position_map_m_(position.position_map_m),
        lever_node_m_(position.lever_node_m),
        whitening_(whitening(position.covariance)),
        weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const PositionResidual residual =
        position_residual(node_at(parameters[0]), position_map_m_, lever_node_m_);
    const Eigen::Matrix3d W = std::sqrt(*weight_) * whitening_;
    Eigen::Map<Eigen::Vector3d>{residuals} = W * residual.value;
    if (jacobians != nullptr && jacobians[0] != nullptr)
      write_jacobian(jacobians[0], W, residual.J);
    return true;
  }
  double chi_squared(const Parameters& node) const {
    return (whitening_ *
            position_residual(node_at(node.data()), position_map_m_, lever_node_m_).value)
        .squaredNorm();
  }

 private:
  Eigen::Vector3d position_map_m_;
  Eigen::Vector3d lever_node_m_;
  Eigen::Matrix3d whitening_;
  const double* weight_;
};

class StopWhenCancelled final : public ceres::IterationCallback {
 public:
  explicit StopWhenCancelled(const CancelFlag& cancel) : cancel_(cancel) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*summary*/) override {
    return cancel_ ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  const CancelFlag& cancel_;
};

ceres::Solver::Options solver_options() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  // CHOLMOD is no faster on these graphs, and its bits are those of whichever BLAS is installed.
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
  GraphWeights weights;
  NodeManifold manifold;
  // Owned by the problem.
  std::vector<RelativeCost*> relative_costs;
  std::vector<PositionCost*> position_costs;
  const PoseGraph* graph = nullptr;
  ceres::Problem problem{[] {
    ceres::Problem::Options options;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }()};
};

GraphProblem::GraphProblem(const PoseGraph& graph) : state_(std::make_unique<State>()) {
  State& state = *state_;
  state.graph = &graph;
  state.nodes.resize(graph.nodes.size());
  state.weights.relative.assign(graph.relative_poses.size(), 1.0);
  state.weights.positions.assign(graph.absolute_positions.size(), 1.0);
  for (std::size_t i = 0; i < graph.nodes.size(); ++i) {
    store(node_pose(graph.nodes[i]), state.nodes[i].data());
    state.problem.AddParameterBlock(state.nodes[i].data(), 7, &state.manifold);
  }
  for (std::size_t i = 0; i < graph.relative_poses.size(); ++i) {
    const RelativePose& edge = graph.relative_poses[i];
    state.relative_costs.push_back(new RelativeCost(edge, &state.weights.relative[i]));
    state.problem.AddResidualBlock(state.relative_costs.back(), nullptr,
                                   state.nodes[edge.from].data(), state.nodes[edge.to].data());
  }
  for (const AbsolutePose& pose : graph.absolute_poses)
    state.problem.AddResidualBlock(new AbsoluteCost(pose), nullptr, state.nodes[pose.node].data());
  for (std::size_t i = 0; i < graph.absolute_positions.size(); ++i) {
    const AbsolutePosition& position = graph.absolute_positions[i];
    state.position_costs.push_back(new PositionCost(position, &state.weights.positions[i]));
    state.problem.AddResidualBlock(state.position_costs.back(), nullptr,
                                   state.nodes[position.node].data());
  }
  if (graph.absolute_poses.empty() && graph.absolute_positions.empty() && !graph.nodes.empty())
    state.problem.SetParameterBlockConstant(state.nodes.front().data());
}

GraphProblem::~GraphProblem() = default;

GraphProblem::Outcome GraphProblem::minimize(int max_iterations, double cost_tolerance,
                                             const CancelFlag& cancel) {
  ceres::Solver::Options options = solver_options();
  options.max_num_iterations = max_iterations;
  options.function_tolerance = cost_tolerance;
  StopWhenCancelled stop(cancel);
  options.callbacks.push_back(&stop);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &state_->problem, &summary);
  if (cancel) throw Cancelled();
  return {2.0 * summary.final_cost,
          summary.num_successful_steps + summary.num_unsuccessful_steps,
          summary.termination_type == ceres::CONVERGENCE};
}

GraphWeights& GraphProblem::weights() { return state_->weights; }

double GraphProblem::relative_chi_squared(std::size_t index) const {
  const RelativePose& edge = state_->graph->relative_poses[index];
  return state_->relative_costs[index]->chi_squared(state_->nodes[edge.from],
                                                    state_->nodes[edge.to]);
}

double GraphProblem::position_chi_squared(std::size_t index) const {
  return state_->position_costs[index]->chi_squared(
      state_->nodes[state_->graph->absolute_positions[index].node]);
}

std::vector<Eigen::Isometry3d> GraphProblem::nodes() const {
  std::vector<Eigen::Isometry3d> out;
  out.reserve(state_->nodes.size());
  for (const Parameters& node : state_->nodes) out.push_back(isometry(node_at(node.data())));
  return out;
}

}  // namespace stillmap::mapping
