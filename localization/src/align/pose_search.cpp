#include "pose_search.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

constexpr double kYawStepRad = 0.035;
constexpr std::size_t kMaxSearchPoints = 600;
constexpr double kMaxSearchRangeM = 60.0;
constexpr int kCellsOfHeight = 64;
/// Share of all points by which the far edge of the window is worse than the prior: breaks ties
/// only.
constexpr double kTieShare = 0.03;
/// Share of the best place's score from which others are alike.
constexpr double kAlikeShare = 0.9;
/// Share of the best floor's hits from which another height is a floor too.
constexpr double kFloorShare = 0.8;

/// Occupied cells around a place: one 64-bit word a column, a bit a cell of height.
class Columns {
 public:
  Columns(const MapIndex::Level& level, const Eigen::Vector3f& centre, float radius_m)
      : edge_m_(level.edge_m), side_(2 * static_cast<int>(radius_m / level.edge_m) + 3) {
    first_ = (centre / edge_m_).array().floor().cast<int>();
    first_ -= Eigen::Array3i(side_ / 2, side_ / 2, kCellsOfHeight / 2);
    words_.assign(static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_), 0);
    level.cells.for_each_near(first_.head<2>(), first_.head<2>() + (side_ - 1),
                              [&](const Eigen::Array3i& cell, const Voxel& /*voxel*/,
                                  const CellBlocks::TileView& /*tile*/) { mark(cell); });
    // One cell of slack up and down takes up a prior that is off in height, roll and pitch.
    for (std::uint64_t& word : words_) word |= (word << 1) | (word >> 1);
  }

  [[nodiscard]] Eigen::Array3i cell_of(const Eigen::Vector3f& p) const {
    return (p / edge_m_).array().floor().cast<int>() - first_;
  }
  [[nodiscard]] int side() const { return side_; }
  [[nodiscard]] const std::uint64_t* row(int x) const {
    return words_.data() + static_cast<std::size_t>(x) * static_cast<std::size_t>(side_);
  }

 private:
  void mark(const Eigen::Array3i& cell) {
    const Eigen::Array3i c = cell - first_;
    if (c.x() < 0 || c.x() >= side_ || c.y() < 0 || c.y() >= side_ || c.z() < 0 ||
        c.z() >= kCellsOfHeight)
      return;
    words_[static_cast<std::size_t>(c.x()) * static_cast<std::size_t>(side_) +
           static_cast<std::size_t>(c.y())] |= std::uint64_t{1} << c.z();
  }

  float edge_m_;
  int side_;
  Eigen::Array3i first_;
  std::vector<std::uint64_t> words_;
};

struct Hypothesis {
  int yaw = 0, x = 0, y = 0;
  double score = 0.0;
  int hits = 0;
};

/// Some of the points that stand, or of those that do not, turned into the map's attitude.
std::vector<Eigen::Vector3f> points_to_try(const Query& query, const Eigen::Matrix3d& R,
                                           bool standing) {
  std::vector<Eigen::Vector3f> near;
  for (std::size_t i = 0; i < query.points.size(); ++i) {
    if ((query.stands[i] != 0) == standing && query.points[i].norm() < kMaxSearchRangeM)
      near.push_back(R.cast<float>() * query.points[i]);
  }
  if (near.size() <= kMaxSearchPoints) return near;
  std::vector<Eigen::Vector3f> some;
  for (std::size_t i = 0; i < kMaxSearchPoints; ++i)
    some.push_back(near[i * near.size() / kMaxSearchPoints]);
  return some;
}

/// Adds each point's hits to the window of translations; `hits` is (2 n + 1)^2, x first.
void count_hits(const Columns& columns, const std::vector<Eigen::Vector3f>& points, int n,
                std::vector<int>& hits) {
  const int width = 2 * n + 1;
  for (const Eigen::Vector3f& p : points) {
    const Eigen::Array3i c = columns.cell_of(p);
    if (c.z() < 0 || c.z() >= kCellsOfHeight) continue;
    if (c.x() - n < 0 || c.x() + n >= columns.side() || c.y() - n < 0 ||
        c.y() + n >= columns.side())
      continue;
    for (int x = 0; x < width; ++x) {
      const std::uint64_t* row = columns.row(c.x() + x - n) + (c.y() - n);
      int* out = hits.data() + static_cast<std::ptrdiff_t>(x) * width;
      for (int y = 0; y < width; ++y) out[y] += static_cast<int>((row[y] >> c.z()) & 1U);
    }
  }
}

/// Heights above a hypothesis [cells], up to `most`, around which what does not stand finds a floor
/// as well: every second one, as a cell of slack and the alignment reach the others.
std::vector<int> other_floors(const Columns& columns, const std::vector<Eigen::Vector3f>& points,
                              const Hypothesis& h, int most) {
  std::vector<int> hits(static_cast<std::size_t>(most / 2 * 2) + 1, 0);
  for (const Eigen::Vector3f& p : points) {
    const Eigen::Array3i c = columns.cell_of(p) + Eigen::Array3i(h.x, h.y, -most / 2 * 2);
    if (c.x() < 0 || c.x() >= columns.side() || c.y() < 0 || c.y() >= columns.side()) continue;
    const std::uint64_t column = columns.row(c.x())[c.y()];
    for (std::size_t k = 0; k < hits.size(); ++k) {
      const int z = c.z() + 2 * static_cast<int>(k);
      if (z >= 0 && z < kCellsOfHeight) hits[k] += static_cast<int>((column >> z) & 1U);
    }
  }
  const double least = std::max(1.0, kFloorShare * *std::max_element(hits.begin(), hits.end()));
  std::vector<int> floors;
  for (std::size_t k = 0; k < hits.size(); ++k) {
    const int up = 2 * static_cast<int>(k) - most / 2 * 2;
    if (up != 0 && hits[k] >= least) floors.push_back(up);
  }
  return floors;
}

bool are_near(const Hypothesis& a, const Hypothesis& b) {
  return std::abs(a.x - b.x) <= 1 && std::abs(a.y - b.y) <= 1;
}

bool same_place(const Hypothesis& a, const Hypothesis& b) {
  return std::abs(a.yaw - b.yaw) <= 2 && are_near(a, b);
}

/// Squared distance from the prior, in steps.
double away2(const Hypothesis& h) { return h.x * h.x + h.y * h.y + h.yaw * h.yaw; }

/// The best `count`, and up to twice as many elsewhere that are almost as good as the first.
std::vector<Hypothesis> best_places(std::vector<Hypothesis>& all, std::size_t count) {
  std::vector<Hypothesis> best;
  while (best.size() < 3 * count && !all.empty()) {
    const Hypothesis top = *std::max_element(
        all.begin(), all.end(), [](const auto& a, const auto& b) { return a.score < b.score; });
    if (best.size() >= count && top.score < kAlikeShare * best.front().score) break;
    best.push_back(top);
    std::erase_if(all, [&](const Hypothesis& h) { return same_place(h, top); });
    if (best.size() < count) continue;
    std::erase_if(all, [&](const Hypothesis& h) {
      return std::any_of(best.begin(), best.end(), [&](const auto& b) { return are_near(h, b); });
    });
  }
  return best;
}

}  // namespace

std::vector<Eigen::Isometry3d> search_poses(const MapIndex::Level& level,
                                            const Eigen::Vector3d& origin, const Query& query,
                                            const Eigen::Isometry3d& T_map_lidar_prior,
                                            const SearchWindow& window) {
  const std::vector<Eigen::Vector3f> points =
      points_to_try(query, T_map_lidar_prior.linear(), true);
  if (points.empty()) return {T_map_lidar_prior};
  const Eigen::Vector3f centre = (T_map_lidar_prior.translation() - origin).cast<float>();
  const double edge_m = static_cast<double>(level.edge_m);
  const int n = static_cast<int>(std::ceil(window.radius_m / edge_m));
  const int yaws = static_cast<int>(std::ceil(window.yaw_rad / kYawStepRad));
  const Columns columns(level, centre, static_cast<float>(kMaxSearchRangeM + edge_m * (n + 1)));
  const double farthest = std::max(1.0, away2({yaws, n, n}));
  const std::size_t side = 2 * static_cast<std::size_t>(n) + 1;
  std::vector<Hypothesis> all;
  std::vector<Eigen::Vector3f> turned(points.size());
  for (int yaw = -yaws; yaw <= yaws; ++yaw) {
    const Eigen::AngleAxisf R(static_cast<float>(yaw * kYawStepRad), Eigen::Vector3f::UnitZ());
    const Eigen::Matrix3f R_yaw = R.toRotationMatrix();
    for (std::size_t i = 0; i < points.size(); ++i) turned[i] = R_yaw * points[i] + centre;
    std::vector<int> hits(side * side, 0);
    count_hits(columns, turned, n, hits);
    for (std::size_t k = 0; k < hits.size(); ++k) {
      Hypothesis h{yaw, static_cast<int>(k / side) - n, static_cast<int>(k % side) - n, 0.0,
                   hits[k]};
      h.score = h.hits - kTieShare * static_cast<double>(points.size()) * away2(h) / farthest;
      all.push_back(h);
    }
  }
  const int floors = static_cast<int>(window.height_m / edge_m);
  const std::vector<Eigen::Vector3f> level_points =
      floors > 1 ? points_to_try(query, T_map_lidar_prior.linear(), false)
                 : std::vector<Eigen::Vector3f>{};
  std::vector<Eigen::Isometry3d> candidates;
  std::size_t looked_up_and_down = 0;
  for (const Hypothesis& h : best_places(all, window.max_candidates)) {
    Eigen::Isometry3d T = T_map_lidar_prior;
    const Eigen::AngleAxisd R_yaw(h.yaw * kYawStepRad, Eigen::Vector3d::UnitZ());
    T.linear() = R_yaw.toRotationMatrix() * T_map_lidar_prior.linear();
    T.translation() += edge_m * Eigen::Vector3d(h.x, h.y, 0.0);
    candidates.push_back(T);
    // Of the best alone: a query of a tower block has its bounds, too.
    if (level_points.empty() || ++looked_up_and_down > window.max_candidates) continue;
    turned.resize(level_points.size());
    for (std::size_t i = 0; i < turned.size(); ++i) {
      turned[i] = R_yaw.toRotationMatrix().cast<float>() * level_points[i] + centre;
    }
    for (const int up : other_floors(columns, turned, h, floors)) {
      candidates.push_back(Eigen::Translation3d(0.0, 0.0, edge_m * up) * T);
    }
  }
  return candidates;
}

}  // namespace stillmap::localization
