#include "cleaning/moved_cells.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <unordered_map>

namespace stillmap::mapping {
namespace {

/// Mean score from which on a cell goes.
constexpr float kMoved = 0.15F;
/// Share of the ball that must go too.
constexpr float kLonely = 0.3F;
/// Share of the ball that takes a cell with it, unless more views than this hit it.
constexpr float kCompany = 0.5F;
constexpr float kFewHits = 10.0F;
constexpr int kGrowSteps = kMovedReachBalls - 2;

/// For each point the others within a ball.
class Neighbours {
 public:
  Neighbours(std::span<const Eigen::Vector3f> positions, float ball_m)
      : positions_(positions), ball_m_(ball_m) {
    for (std::uint32_t i = 0; i < positions.size(); ++i)
      cells_[key(cell(positions[i]))].push_back(i);
  }

  /// Calls `take(j)` for every j != i within the ball, in an order that follows from the positions
  /// and their order.
  template <typename Take>
  void visit(std::size_t i, const Take& take) const {
    const Eigen::Vector3f& p = positions_[i];
    const Eigen::Vector3i centre = cell(p);
    for (int dz = -1; dz <= 1; ++dz) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const auto at = cells_.find(key(centre + Eigen::Vector3i(dx, dy, dz)));
          if (at == cells_.end()) continue;
          for (const std::uint32_t j : at->second) {
            if (j != i && (positions_[j] - p).squaredNorm() <= ball_m_ * ball_m_) take(j);
          }
        }
      }
    }
  }

 private:
  [[nodiscard]] Eigen::Vector3i cell(const Eigen::Vector3f& p) const {
    return (p / ball_m_).array().floor().cast<int>();
  }
  [[nodiscard]] static std::uint64_t key(const Eigen::Vector3i& c) {
    constexpr std::uint64_t kMask = (1U << 21U) - 1;
    return ((static_cast<std::uint64_t>(c.x()) & kMask) << 42U) |
           ((static_cast<std::uint64_t>(c.y()) & kMask) << 21U) |
           (static_cast<std::uint64_t>(c.z()) & kMask);
  }

  std::span<const Eigen::Vector3f> positions_;
  float ball_m_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cells_;
};

/// Adjacent points of each in one list.
struct Adjacency {
  std::vector<std::uint32_t> first, others;
  Adjacency(std::span<const Eigen::Vector3f> positions, float ball_m) {
    const Neighbours neighbours(positions, ball_m);
    first.reserve(positions.size() + 1);
    for (std::size_t i = 0; i < positions.size(); ++i) {
      first.push_back(static_cast<std::uint32_t>(others.size()));
      neighbours.visit(i, [&](std::uint32_t j) { others.push_back(j); });
    }
    first.push_back(static_cast<std::uint32_t>(others.size()));
  }
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t i) const {
    return std::span(others).subspan(first[i], first[i + 1] - first[i]);
  }
};

std::size_t going(std::span<const std::uint32_t> ball, const std::vector<std::uint8_t>& moved) {
  return static_cast<std::size_t>(
      std::count_if(ball.begin(), ball.end(), [&](std::uint32_t j) { return moved[j] != 0; }));
}

}  // namespace

std::vector<std::uint8_t> moved_cells(std::span<const Eigen::Vector3f> positions,
                                      std::span<const FreeEvidence> evidence, float ball_m) {
  if (evidence.size() != positions.size())
    throw std::invalid_argument("evidence: expected one a point");
  if (!(ball_m > 0.0F)) throw std::invalid_argument("ball: expected > 0");
  const Adjacency adjacency(positions, ball_m);
  std::vector<std::uint8_t> moved(positions.size());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const auto ball = adjacency.of(i);
    float sum = evidence[i].score;
    for (const std::uint32_t j : ball) sum += evidence[j].score;
    moved[i] = sum > kMoved * static_cast<float>(ball.size() + 1) ? 1 : 0;
  }
  std::vector<std::uint8_t> next = moved;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const auto ball = adjacency.of(i);
    if (moved[i] != 0 &&
        static_cast<float>(going(ball, moved)) < kLonely * static_cast<float>(ball.size()))
      next[i] = 0;
  }
  moved = next;
  for (int step = 0; step < kGrowSteps; ++step) {
    for (std::size_t i = 0; i < moved.size(); ++i) {
      if (moved[i] != 0 || evidence[i].hits > kFewHits) continue;
      const auto ball = adjacency.of(i);
      if (ball.size() >= 3 &&
          static_cast<float>(going(ball, moved)) >= kCompany * static_cast<float>(ball.size()))
        next[i] = 1;
    }
    moved = next;
  }
  return moved;
}

}  // namespace stillmap::mapping
