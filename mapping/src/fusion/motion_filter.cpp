#include "fusion/motion_filter.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr double kAnySpeedMps = 100.0;

Eigen::Matrix2d transition(double dt_s) {
  Eigen::Matrix2d F;
  F << 1.0, dt_s, 0.0, 1.0;
  return F;
}

}  // namespace

MotionState started_at(const Eigen::Vector2d& position, double sigma_m, const MotionNoise& noise) {
  MotionState state;
  state.position = position;
  state.covariance << sigma_m * sigma_m, 0.0, 0.0,
      noise.unknown_speed_mps * noise.unknown_speed_mps;
  return state;
}

MotionState predicted(const MotionState& state, double dt_s, const MotionNoise& noise) {
  MotionState next;
  next.position = state.position + dt_s * state.velocity_mps;
  next.velocity_mps = state.velocity_mps;
  const Eigen::Matrix2d F = transition(dt_s);
  Eigen::Matrix2d Q;
  Q << dt_s * dt_s * dt_s / 3.0, 0.5 * dt_s * dt_s, 0.5 * dt_s * dt_s, dt_s;
  next.covariance = F * state.covariance * F.transpose() + noise.acceleration_density * Q;
  return next;
}

MotionState updated(const MotionState& state, const Eigen::Vector2d& position, double sigma_m) {
  const Eigen::Vector2d gain =
      state.covariance.col(0) / (state.covariance(0, 0) + sigma_m * sigma_m);
  const Eigen::Vector2d innovation = position - state.position;
  MotionState next;
  next.position = state.position + gain[0] * innovation;
  next.velocity_mps = state.velocity_mps + gain[1] * innovation;
  next.covariance = state.covariance - gain * state.covariance.row(0);
  // Rounding must not make it lopsided over thousands of steps.
  next.covariance = 0.5 * (next.covariance + next.covariance.transpose()).eval();
  return next;
}

std::vector<MotionState> smoothed_path(const std::vector<PathStep>& steps,
                                       const MotionNoise& noise) {
  const auto measured = [](const PathStep& step) { return step.position.has_value(); };
  const auto begin = std::find_if(steps.begin(), steps.end(), measured);
  if (begin == steps.end()) throw std::invalid_argument("path: no measured position, expected one");
  const auto first = static_cast<std::size_t>(begin - steps.begin());
  std::vector<MotionState> before(steps.size()), path(steps.size());
  // What follows tells the speed; a prior would only slow it down.
  path[first] = started_at(*begin->position, begin->sigma_m, {0.0, kAnySpeedMps});
  for (std::size_t i = first + 1; i < steps.size(); ++i) {
    before[i] = predicted(path[i - 1], steps[i].time_s - steps[i - 1].time_s, noise);
    path[i] =
        steps[i].position ? updated(before[i], *steps[i].position, steps[i].sigma_m) : before[i];
  }
  for (std::size_t i = steps.size() - 1; i-- > first;) {
    const Eigen::Matrix2d F = transition(steps[i + 1].time_s - steps[i].time_s);
    const Eigen::Matrix2d C =
        path[i].covariance * F.transpose() * before[i + 1].covariance.inverse();
    const Eigen::Vector2d d_position = path[i + 1].position - before[i + 1].position;
    const Eigen::Vector2d d_velocity = path[i + 1].velocity_mps - before[i + 1].velocity_mps;
    path[i].position += C(0, 0) * d_position + C(0, 1) * d_velocity;
    path[i].velocity_mps += C(1, 0) * d_position + C(1, 1) * d_velocity;
    path[i].covariance += C * (path[i + 1].covariance - before[i + 1].covariance) * C.transpose();
  }
  for (std::size_t i = first; i-- > 0;)
    path[i] = predicted(path[first], steps[i].time_s - steps[first].time_s, {0.0, 0.0});
  return path;
}

}  // namespace stillmap::mapping
