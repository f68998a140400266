#include "ground/seed_plane.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>

namespace stillmap::mapping {
namespace {

constexpr int kHypotheses = 200;
constexpr double kMaxSlope = 0.3;
constexpr double kInlierM = 0.12;
constexpr double kBelowM = 0.3;
constexpr int kMinInliers = 6;

/// A small generator of its own: std distributions differ between standard libraries.
class Picker {
 public:
  explicit Picker(std::size_t size) : size_(size) {}
  std::size_t next() {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<std::size_t>(state_ >> 33) % size_;
  }

 private:
  std::uint64_t state_ = 0x5eed;
  std::size_t size_;
};

[[nodiscard]] bool is_plausible(const SeedPlane& plane, const std::optional<HeightPrior>& prior) {
  if (prior && std::abs(plane.height + prior->height_m) > prior->tolerance_m) return false;
  return plane.height < 0.0 && plane.slope.norm() <= kMaxSlope;
}

[[nodiscard]] std::optional<SeedPlane> through(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                               const Eigen::Vector3d& c) {
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  // Nearly collinear triples give wild slopes; 1 m^2 is a triangle of some 1.5 m.
  if (!(std::abs(normal.z()) > 1.0)) return std::nullopt;
  SeedPlane plane;
  plane.slope = -normal.head<2>() / normal.z();
  plane.height = a.z() - plane.slope.dot(a.head<2>());
  return plane;
}

[[nodiscard]] int score(const SeedPlane& plane, const std::vector<Eigen::Vector3d>& lows) {
  int score = 0;
  for (const Eigen::Vector3d& p : lows) {
    const double above = p.z() - plane.z_at(p.x(), p.y());
    if (std::abs(above) <= kInlierM) ++score;
    // Ground has little below it; reflections do occur, so it is a penalty and no veto.
    if (above < -kBelowM) score -= 2;
  }
  return score;
}

[[nodiscard]] SeedPlane refined(const SeedPlane& plane, const std::vector<Eigen::Vector3d>& lows) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Identity() * 1e-6;
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : lows) {
    const double above = p.z() - plane.z_at(p.x(), p.y());
    if (std::abs(above) > kInlierM) continue;
    const Eigen::Vector3d row(1.0, p.x(), p.y());
    A += row * row.transpose();
    b += row * above;
  }
  const Eigen::Vector3d step = maps::ldlt_solve(A, b);
  return SeedPlane{plane.height + step.x(), plane.slope + step.tail<2>()};
}

}  // namespace

std::optional<SeedPlane> find_seed_plane(const std::vector<Eigen::Vector3d>& lows,
                                         const std::optional<HeightPrior>& prior) {
  if (lows.size() < kMinInliers) return std::nullopt;
  Picker picker(lows.size());
  std::optional<SeedPlane> best;
  int best_score = kMinInliers - 1;
  for (int h = 0; h < kHypotheses; ++h) {
    const Eigen::Vector3d& a = lows[picker.next()];
    const Eigen::Vector3d& b = lows[picker.next()];
    const auto plane = through(a, b, lows[picker.next()]);
    if (!plane || !is_plausible(*plane, prior)) continue;
    const int s = score(*plane, lows);
    if (s <= best_score) continue;
    best_score = s;
    best = plane;
  }
  if (!best) return std::nullopt;
  const SeedPlane better = refined(refined(*best, lows), lows);
  return is_plausible(better, prior) ? better : *best;
}

}  // namespace stillmap::mapping
