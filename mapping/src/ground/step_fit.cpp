#include "ground/step_fit.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kMinSamples = 12;
constexpr int kAngles = 36;
constexpr double kBinM = 0.125;
constexpr double kPullSamples = 3.0;
/// Residuals beyond this lose their say [m].
constexpr double kScaleM = 0.04;
constexpr int kStepRounds = 3;
constexpr double kLowestStepM = 0.04;
constexpr double kHighestStepM = 0.35;
/// How much better two planes must be than one.
constexpr double kGain = 0.5;
constexpr double kMinSideWeight = 4.0;
constexpr double kBesideLineM = 3.0;
/// What it costs to have the whole rectangle halved by a step, and to have all of it on the upper
/// side [m^2]: less than one cell on the wrong side of a kerb that was seen, but enough to move one
/// that was not out of the rectangle. Objects stand beside kerbs, and rather below.
constexpr double kHalvedCost = 0.02;
constexpr double kUpperCost = 0.002;
/// And to have a step at 45 degrees to the rectangle's sides [m^2]: one parks along a kerb or
/// square to it.
constexpr double kTurnedCost = 0.12;
constexpr int kSeenSamples = 3;

/// Sums of the normal equations; sums of disjoint sets add and subtract.
struct Sums {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double zz = 0.0;

  void add(const HeightSample& s, double weight) {
    const Eigen::Vector3d row(1.0, s.p.x(), s.p.y());
    A += weight * row * row.transpose();
    b += weight * s.z * row;
    zz += weight * s.z * s.z;
  }
  Sums& operator+=(const Sums& other) {
    A += other.A;
    b += other.b;
    zz += other.zz;
    return *this;
  }
  [[nodiscard]] Sums operator-(const Sums& other) const {
    return {A - other.A, b - other.b, zz - other.zz};
  }
  [[nodiscard]] double weight() const { return A(0, 0); }
};

struct Solved {
  Eigen::Vector3d plane;
  double cost;
};

Solved solve(const Sums& sums, const Eigen::Vector2d& slope) {
  Eigen::Matrix3d A = sums.A;
  Eigen::Vector3d b = sums.b;
  A(0, 0) += 1e-9;
  A(1, 1) += kPullSamples;
  A(2, 2) += kPullSamples;
  b.tail<2>() += kPullSamples * slope;
  const Eigen::Vector3d plane = maps::ldlt_solve(A, b);
  const double pulled = kPullSamples * (plane.tail<2>() - slope).squaredNorm();
  const double cost = sums.zz - 2.0 * plane.dot(sums.b) + plane.dot(sums.A * plane) + pulled;
  return {plane, std::max(0.0, cost)};
}

class StepSearch {
 public:
  StepSearch(std::span<const HeightSample> samples, const StepBounds& bounds)
      : samples_(samples), bounds_(bounds), weights_(samples.size()) {
    for (std::size_t k = 0; k < samples.size(); ++k) weights_[k] = samples[k].weight;
  }

  SteppedPlane run() {
    SteppedPlane best;
    for (int round = 0; round < kStepRounds; ++round) {
      best = best_now();
      for (std::size_t k = 0; k < samples_.size(); ++k) {
        const double r = (samples_[k].z - best.z_at(samples_[k].p)) / kScaleM;
        weights_[k] = samples_[k].weight / ((1.0 + r * r) * (1.0 + r * r));
      }
    }
    return best;
  }

 private:
  SteppedPlane best_now() {
    Sums all;
    for (std::size_t k = 0; k < samples_.size(); ++k) all.add(samples_[k], weights_[k]);
    const Solved one = solve(all, bounds_.slope);
    SteppedPlane best;
    best.planes = {one.plane, one.plane};
    // Noise alone must not call for a step.
    double least = kGain * one.cost - 1e-6 * all.weight();
    for (int angle = 0; angle < kAngles; ++angle) {
      const double a = angle * std::numbers::pi / kAngles;
      try_lines(Eigen::Vector2d(-std::sin(a), std::cos(a)), all, least, best);
    }
    return best;
  }

  void try_lines(const Eigen::Vector2d& normal, const Sums& all, double& least,
                 SteppedPlane& best) {
    const double reach = normal.cwiseAbs().dot(bounds_.half_m);
    const int splits = 2 * static_cast<int>(reach / kBinM) + 1;
    const double first = -kBinM * (splits / 2);
    const auto bin_of = [&](const Eigen::Vector2d& p) {
      return std::max(0, static_cast<int>(std::ceil((normal.dot(p) - first) / kBinM)));
    };
    bins_.assign(static_cast<std::size_t>(splits), Sums{});
    for (std::size_t k = 0; k < samples_.size(); ++k) {
      const int bin = bin_of(samples_[k].p);
      if (bin < splits) bins_[static_cast<std::size_t>(bin)].add(samples_[k], weights_[k]);
    }
    const std::vector<double> covered = cover(splits, bin_of);
    Sums below;
    for (int split = 0; split < splits; ++split) {
      below += bins_[static_cast<std::size_t>(split)];
      const Sums above = all - below;
      if (below.weight() < kMinSideWeight || above.weight() < kMinSideWeight) continue;
      const Solved low = solve(below, bounds_.slope);
      const Solved high = solve(above, bounds_.slope);
      const SteppedPlane candidate{{low.plane, high.plane}, true, normal, first + kBinM * split};
      const double cost =
          low.cost + high.cost + standing_cost(candidate, covered[static_cast<std::size_t>(split)]);
      if (!(cost < least) || !is_kerb(candidate)) continue;
      least = cost;
      best = candidate;
    }
  }

  /// Share of the rectangle below each split.
  template <typename BinOf>
  [[nodiscard]] std::vector<double> cover(int splits, const BinOf& bin_of) const {
    std::vector<double> covered(static_cast<std::size_t>(splits), 0.0);
    constexpr int kAlong = 10, kAcross = 6;
    for (int i = 0; i < kAlong * kAcross; ++i) {
      const Eigen::Vector2d share((i % kAlong + 0.5) / kAlong, (i / kAlong + 0.5) / kAcross);
      const int bin = bin_of((2.0 * share.array() - 1.0) * bounds_.half_m.array());
      for (int split = bin; split < splits; ++split)
        covered[static_cast<std::size_t>(split)] += 1.0 / (kAlong * kAcross);
    }
    return covered;
  }

  [[nodiscard]] static double standing_cost(const SteppedPlane& candidate, double below) {
    const Eigen::Vector2d foot = candidate.offset * candidate.normal;
    const double upper = candidate.z_at(foot, 1) > candidate.z_at(foot, 0) ? 1.0 - below : below;
    const double turned = 2.0 * candidate.normal.x() * candidate.normal.y();  // sin(2 a)
    return kHalvedCost * 2.0 * std::min(below, 1.0 - below) + kUpperCost * upper +
           kTurnedCost * turned * turned;
  }

  /// Whether the step has the height of a kerb along the rectangle, and is seen at one end.
  [[nodiscard]] bool is_kerb(const SteppedPlane& candidate) const {
    const Eigen::Vector2d along(candidate.normal.y(), -candidate.normal.x());
    const Eigen::Vector2d foot = candidate.offset * candidate.normal;
    const double length = along.cwiseAbs().dot(bounds_.half_m);
    double sum = 0.0;
    int count = 0;
    for (double s = -length; s <= length; s += 0.25) {
      const Eigen::Vector2d p = foot + s * along;
      if (((p.cwiseAbs() - bounds_.half_m).array() > 0.0).any()) continue;
      sum += candidate.z_at(p, 1) - candidate.z_at(p, 0);
      ++count;
    }
    if (count == 0) return false;
    const double step = std::abs(sum / count);
    if (!(step >= kLowestStepM && step <= kHighestStepM)) return false;
    std::array<int, 4> seen{};
    for (std::size_t k = 0; k < samples_.size(); ++k) {
      const double away = candidate.normal.dot(samples_[k].p) - candidate.offset;
      if (std::abs(away) > kBesideLineM || weights_[k] < 0.25 * samples_[k].weight) continue;
      const bool ahead = along.dot(samples_[k].p) > 0.0;
      ++seen[static_cast<std::size_t>((ahead ? 2 : 0) + (away > 0.0 ? 1 : 0))];
    }
    return (seen[0] >= kSeenSamples && seen[1] >= kSeenSamples) ||
           (seen[2] >= kSeenSamples && seen[3] >= kSeenSamples);
  }

  std::span<const HeightSample> samples_;
  const StepBounds& bounds_;
  std::vector<double> weights_;
  std::vector<Sums> bins_;
};

}  // namespace

std::optional<SteppedPlane> fit_stepped_plane(std::span<const HeightSample> samples,
                                              const StepBounds& bounds) {
  if (samples.size() < kMinSamples) return std::nullopt;
  return StepSearch(samples, bounds).run();
}

}  // namespace stillmap::mapping
