#include "ground/kerb_run.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr double kSeenM = 0.5;
constexpr double kSeenWeight = 1.5;
constexpr double kRunReachM = 12.0;
constexpr int kRounds = 3;
/// A sample nearer to the line tells nothing about its sides [m].
constexpr double kLineM = 0.25;
/// Residuals count up to this [m]: what is no ground must not decide.
constexpr double kCapM = 0.1;
/// Heights of less weight beyond the line say nothing.
constexpr double kMinWeight = 1.0;

[[nodiscard]] Eigen::Vector2d to_local(const GroundFootprint& footprint, const Eigen::Vector2d& d) {
  const Eigen::Vector2d h = footprint.heading;
  return {h.x() * d.x() - h.y() * d.y(), h.y() * d.x() + h.x() * d.y()};
}
[[nodiscard]] Eigen::Vector2d to_footprint(const GroundFootprint& footprint,
                                           const Eigen::Vector2d& d) {
  const Eigen::Vector2d h = footprint.heading;
  return {h.dot(d), h.x() * d.y() - h.y() * d.x()};
}

/// Weight of the samples on each side of a line, between two distances from it.
[[nodiscard]] std::array<double, 2> weight_beside(const std::vector<HeightSample>& samples,
                                                  const Eigen::Vector2d& normal, double offset,
                                                  double nearest_m, double farthest_m) {
  std::array<double, 2> weight{};
  for (const HeightSample& sample : samples) {
    const double away = normal.dot(sample.p) - offset;
    if (std::abs(away) < nearest_m || std::abs(away) > farthest_m) continue;
    weight[away > 0.0 ? 1 : 0] += sample.weight;
  }
  return weight;
}

/// The flat fit with the kerb's step: the side that was seen keeps its plane, the other one lies
/// higher or lower by the rise and slopes as beside the kerb.
[[nodiscard]] SteppedPlane with_step(const SteppedPlane& flat, const GroundFootprint& footprint,
                                     const Kerb& kerb, std::size_t seen_side) {
  SteppedPlane stepped = flat;
  stepped.has_step = true;
  stepped.normal = to_footprint(footprint, kerb.normal);
  stepped.offset = kerb.normal.dot(kerb.foot - footprint.centre.head<2>());
  const std::size_t other = 1 - seen_side;
  const Eigen::Vector2d slope = to_footprint(footprint, kerb.slopes[other]);
  const Eigen::Vector2d at = stepped.offset * stepped.normal;
  const double z = flat.z_at(at, 0) + (other == 1 ? kerb.rise : -kerb.rise);
  stepped.planes[other] = {z - slope.dot(at), slope.x(), slope.y()};
  return stepped;
}

/// Whether the heights beyond the line fit the step at least as well as the plane.
[[nodiscard]] bool agrees(const std::vector<HeightSample>& samples, const SteppedPlane& flat,
                          const SteppedPlane& stepped, std::size_t other) {
  double weight = 0.0, off_flat = 0.0, off_stepped = 0.0;
  for (const HeightSample& sample : samples) {
    const double away = stepped.normal.dot(sample.p) - stepped.offset;
    if ((other == 1 ? away : -away) < kLineM) continue;
    weight += sample.weight;
    off_flat += sample.weight * std::min(kCapM, std::abs(sample.z - flat.z_at(sample.p)));
    off_stepped += sample.weight * std::min(kCapM, std::abs(sample.z - stepped.z_at(sample.p)));
  }
  return weight < kMinWeight || off_stepped < off_flat;
}

[[nodiscard]] bool runs_through(const Kerb& kerb, const GroundFootprint& footprint) {
  const Eigen::Vector2d normal = to_footprint(footprint, kerb.normal);
  const double offset = kerb.normal.dot(kerb.foot - footprint.centre.head<2>());
  return std::abs(offset) <= normal.cwiseAbs().dot(footprint.half_m);
}

[[nodiscard]] const Kerb* nearest(const std::vector<Kerb>& kerbs,
                                  const GroundFootprint& footprint) {
  const Kerb* best = nullptr;
  double least = kRunReachM;
  for (const Kerb& kerb : kerbs) {
    const double away = (kerb.foot - footprint.centre.head<2>()).norm();
    if (away > least || !runs_through(kerb, footprint)) continue;
    best = &kerb;
    least = away;
  }
  return best;
}

/// @return the kerb as it goes on, if it does.
std::optional<Kerb> continue_under(const GroundFootprint& footprint, const std::vector<Kerb>& kerbs,
                                   FittedFootprint& fitted) {
  if (!fitted.planes || fitted.planes->has_step) return std::nullopt;
  const Kerb* kerb = nearest(kerbs, footprint);
  if (kerb == nullptr) return std::nullopt;
  const Eigen::Vector2d normal = to_footprint(footprint, kerb->normal);
  const double offset = kerb->normal.dot(kerb->foot - footprint.centre.head<2>());
  const auto weight = weight_beside(fitted.samples, normal, offset, 0.0, kRunReachM);
  const std::size_t seen_side = weight[1] > weight[0] ? 1 : 0;
  const SteppedPlane stepped = with_step(*fitted.planes, footprint, *kerb, seen_side);
  if (!agrees(fitted.samples, *fitted.planes, stepped, 1 - seen_side)) return std::nullopt;
  fitted.planes = stepped;
  Kerb further = *kerb;
  const Eigen::Vector2d along(kerb->normal.y(), -kerb->normal.x());
  further.foot += along * along.dot(footprint.centre.head<2>() - kerb->foot);
  return further;
}

}  // namespace

std::optional<Kerb> seen_kerb(const GroundFootprint& footprint, const FittedFootprint& fitted) {
  if (!fitted.planes || !fitted.planes->has_step) return std::nullopt;
  const SteppedPlane& planes = *fitted.planes;
  const auto weight = weight_beside(fitted.samples, planes.normal, planes.offset, 0.0, kSeenM);
  if (weight[0] < kSeenWeight || weight[1] < kSeenWeight) return std::nullopt;
  const Eigen::Vector2d at = planes.offset * planes.normal;
  Kerb kerb;
  kerb.foot = footprint.centre.head<2>() + to_local(footprint, at);
  kerb.normal = to_local(footprint, planes.normal);
  kerb.rise = planes.z_at(at, 1) - planes.z_at(at, 0);
  for (std::size_t side = 0; side < 2; ++side)
    kerb.slopes[side] = to_local(footprint, planes.planes[side].tail<2>());
  return kerb;
}

void continue_kerbs(std::span<const GroundFootprint> footprints,
                    std::vector<FittedFootprint>& fitted) {
  std::vector<Kerb> kerbs;
  for (std::size_t i = 0; i < footprints.size(); ++i) {
    if (const auto kerb = seen_kerb(footprints[i], fitted[i])) kerbs.push_back(*kerb);
  }
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Kerb> further;
    for (std::size_t i = 0; i < footprints.size(); ++i) {
      if (const auto kerb = continue_under(footprints[i], kerbs, fitted[i]))
        further.push_back(*kerb);
    }
    kerbs.insert(kerbs.end(), further.begin(), further.end());
  }
}

}  // namespace stillmap::mapping
