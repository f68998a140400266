#include "cleaning/moved_cells.hpp"

#include <stillmap/maps/cell_table.hpp>

#include "cleaning/thin_upright.hpp"

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Mean score from which on a cell goes, and one of something thin that stands upright.
constexpr float kMoved = 0.15F;
constexpr float kMovedThin = 0.45F;
/// Share of the ball that must go too.
constexpr float kLonely = 0.3F;
/// Share of the ball that takes a cell with it, unless more views than this hit it.
constexpr float kCompany = 0.5F;
constexpr float kFewHits = 10.0F;
constexpr std::size_t kBallOfOthers = 3;
constexpr int kGrowSteps = kMovedReachBalls - 3;

/// Space in cubes as wide as a ball, so that the points within a ball are in 27 of them.
class Cubes {
 public:
  Cubes(std::span<const Eigen::Vector3f> positions, float ball_m)
      : positions_(positions), ball_m_(ball_m) {
    for (std::uint32_t i = 0; i < positions.size(); ++i)
      cubes_[key(cube(positions[i]))].push_back(i);
  }

  /// Marks all points that are within a ball of a marked one, and some farther ones.
  [[nodiscard]] std::vector<std::uint8_t> near(const std::vector<std::uint8_t>& marked) const {
    maps::CellTable reached;
    for (const auto& [at, numbers] : cubes_) {
      if (std::none_of(numbers.begin(), numbers.end(),
                       [&](std::uint32_t i) { return marked[i] != 0; }))
        continue;
      const Eigen::Vector3i centre = cube(positions_[numbers.front()]);
      for (int n = 0; n < 27; ++n) reached.insert(key(centre + step(n)));
    }
    std::vector<std::uint8_t> near(positions_.size());
    for (std::size_t i = 0; i < near.size(); ++i)
      near[i] = reached.contains(key(cube(positions_[i]))) ? 1 : 0;
    return near;
  }

  /// Appends every j != i within the ball around i, in an order that follows from the positions
  /// and their order alone.
  void append_ball(std::size_t i, std::vector<std::uint32_t>& others) const {
    const Eigen::Vector3f& p = positions_[i];
    const Eigen::Vector3i centre = cube(p);
    for (int n = 0; n < 27; ++n) {
      const std::vector<std::uint32_t>* numbers = cubes_.find(key(centre + step(n)));
      if (numbers == nullptr) continue;
      for (const std::uint32_t j : *numbers) {
        if (j != i && (positions_[j] - p).squaredNorm() <= ball_m_ * ball_m_) others.push_back(j);
      }
    }
  }

 private:
  [[nodiscard]] static Eigen::Vector3i step(int n) { return {n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1}; }
  [[nodiscard]] Eigen::Vector3i cube(const Eigen::Vector3f& p) const {
    return (p / ball_m_).array().floor().cast<int>();
  }
  [[nodiscard]] static std::uint64_t key(const Eigen::Vector3i& c) {
    return maps::signed_cell_key(c.x(), c.y(), c.z());
  }

  std::span<const Eigen::Vector3f> positions_;
  float ball_m_;
  maps::CellMap<std::vector<std::uint32_t>> cubes_;
};

/// The balls around some points, in one list.
class Balls {
 public:
  /// @param wanted  flags; the others' balls are empty.
  Balls(const Cubes& cubes, const std::vector<std::uint8_t>& wanted) {
    first_.reserve(wanted.size() + 1);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      first_.push_back(others_.size());
      if (wanted[i] != 0) cubes.append_ball(i, others_);
    }
    first_.push_back(others_.size());
  }
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t i) const {
    return std::span(others_).subspan(first_[i], first_[i + 1] - first_[i]);
  }

 private:
  std::vector<std::size_t> first_;
  std::vector<std::uint32_t> others_;
};

std::size_t going(std::span<const std::uint32_t> ball, const std::vector<std::uint8_t>& moved) {
  return static_cast<std::size_t>(
      std::count_if(ball.begin(), ball.end(), [&](std::uint32_t j) { return moved[j] != 0; }));
}

bool share_goes(std::span<const std::uint32_t> ball, const std::vector<std::uint8_t>& moved,
                float share) {
  return static_cast<float>(going(ball, moved)) >= share * static_cast<float>(ball.size());
}

/// What goes by its own mean, and what stays because it is thin.
struct Judged {
  std::vector<std::uint8_t> moved;
  std::vector<std::uint8_t> spared;
};

Judged high_on_average(std::span<const Eigen::Vector3f> positions,
                       std::span<const FreeEvidence> evidence, const Balls& balls) {
  std::vector<std::uint8_t> moved(evidence.size());
  std::vector<float> mean(evidence.size());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const auto ball = balls.of(i);
    float sum = evidence[i].score;
    for (const std::uint32_t j : ball) sum += evidence[j].score;
    mean[i] = sum / static_cast<float>(ball.size() + 1);
    moved[i] = mean[i] > kMoved ? 1 : 0;
  }
  std::vector<std::uint8_t> spared = thin_upright(positions, moved);
  for (std::size_t i = 0; i < moved.size(); ++i) {
    if (mean[i] > kMovedThin) spared[i] = 0;
    if (spared[i] != 0) moved[i] = 0;
  }
  return {std::move(moved), std::move(spared)};
}

void leave_lonely(std::vector<std::uint8_t>& moved, const Balls& balls) {
  const std::vector<std::uint8_t> before = moved;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    if (moved[i] != 0 && !share_goes(balls.of(i), before, kLonely)) moved[i] = 0;
  }
}

void grow(Judged& judged, std::span<const FreeEvidence> evidence, const Balls& balls) {
  auto& [moved, spared] = judged;
  const std::vector<std::uint8_t> before = moved;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    if (moved[i] != 0 || spared[i] != 0 || evidence[i].hits > kFewHits) continue;
    const auto ball = balls.of(i);
    if (ball.size() >= kBallOfOthers && share_goes(ball, before, kCompany)) moved[i] = 1;
  }
}

}  // namespace

std::vector<std::uint8_t> moved_cells(std::span<const Eigen::Vector3f> positions,
                                      std::span<const FreeEvidence> evidence, float ball_m) {
  if (evidence.size() != positions.size())
    throw std::invalid_argument("evidence: expected one a point");
  if (!(ball_m > 0.0F)) throw std::invalid_argument("ball: expected > 0");
  const Cubes cubes(positions, ball_m);
  // Away from every cell with a score nothing goes, and that is most of a map.
  std::vector<std::uint8_t> concerned(positions.size());
  for (std::size_t i = 0; i < concerned.size(); ++i) concerned[i] = evidence[i].score > 0.0F;
  for (int step = 0; step <= kGrowSteps; ++step) concerned = cubes.near(concerned);
  const Balls balls(cubes, concerned);
  Judged judged = high_on_average(positions, evidence, balls);
  leave_lonely(judged.moved, balls);
  for (int step = 0; step < kGrowSteps; ++step) grow(judged, evidence, balls);
  return judged.moved;
}

}  // namespace stillmap::mapping
