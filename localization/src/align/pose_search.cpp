#include "pose_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

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

/// std::floor would be a call.
int rounded_down(float at) {
  const int towards_0 = static_cast<int>(at);
  return towards_0 - (at < static_cast<float>(towards_0) ? 1 : 0);
}

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
    return Eigen::Array3i(rounded_down(p.x() / edge_m_), rounded_down(p.y() / edge_m_),
                          rounded_down(p.z() / edge_m_)) -
           first_;
  }
  /// 1 for each occupied cell of a height, x first, and `padding` numbers more.
  void read_layer(int z, std::size_t padding, std::vector<std::uint16_t>& layer) const {
    layer.resize(words_.size() + padding);
    for (std::size_t i = 0; i < words_.size(); ++i)
      layer[i] = static_cast<std::uint16_t>(words_[i] >> z & 1U);
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

Eigen::Matrix3f R_of(int yaw) {
  return Eigen::AngleAxisf(static_cast<float>(yaw * kYawStepRad), Eigen::Vector3f::UnitZ())
      .toRotationMatrix();
}

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

/// Hits of some points for all yaws and translations of a window.
class Hits {
 public:
  Hits(int yaws, int n)
      : yaws_(yaws),
        n_(n),
        width_(2 * n + 1),
        padded_((static_cast<std::size_t>(width_) + kAtOnce - 1) / kAtOnce * kAtOnce),
        hits_(static_cast<std::size_t>((2 * yaws + 1) * width_) * padded_) {}

  [[nodiscard]] int at(int yaw, int x, int y) const {
    return hits_[first_of(yaw, x) + static_cast<std::size_t>(y + n_)];
  }

  /// @param points  fewer than 65,536, relative to `centre` before they are turned.
  void count(const Columns& columns, const std::vector<Eigen::Vector3f>& points,
             const Eigen::Vector3f& centre) {
    // A point stays in its layer of height. Layer by layer, what is read fits into the cache.
    std::array<std::vector<Eigen::Vector3f>, kCellsOfHeight> by_layer;
    for (const Eigen::Vector3f& p : points) {
      const int z = columns.cell_of(p + centre).z();
      if (z >= 0 && z < kCellsOfHeight) by_layer[static_cast<std::size_t>(z)].push_back(p);
    }
    std::vector<Eigen::Matrix3f> R_of_yaw;
    for (int yaw = -yaws_; yaw <= yaws_; ++yaw) R_of_yaw.push_back(R_of(yaw));
    std::vector<std::uint16_t> layer;
    for (int z = 0; z < kCellsOfHeight; ++z) {
      const std::vector<Eigen::Vector3f>& in_layer = by_layer[static_cast<std::size_t>(z)];
      if (in_layer.empty()) continue;
      columns.read_layer(z, padded_, layer);
      for (int yaw = -yaws_; yaw <= yaws_; ++yaw) {
        const Eigen::Matrix3f& R = R_of_yaw[static_cast<std::size_t>(yaw + yaws_)];
        for (const Eigen::Vector3f& p : in_layer) {
          const Eigen::Array3i c = columns.cell_of(R * p + centre);
          if (c.x() - n_ < 0 || c.x() + n_ >= columns.side() || c.y() - n_ < 0 ||
              c.y() + n_ >= columns.side())
            continue;
          add(layer.data() + (c.x() - n_) * columns.side() + c.y() - n_, columns.side(),
              &hits_[first_of(yaw, -n_)]);
        }
      }
    }
  }

 private:
  static constexpr std::size_t kAtOnce = 16;

  [[nodiscard]] std::size_t first_of(int yaw, int x) const {
    return static_cast<std::size_t>((yaw + yaws_) * width_ + x + n_) * padded_;
  }
  /// Adds a window of a layer, whose rows are `side` apart.
  void add(const std::uint16_t* from, int side, std::uint16_t* to) const {
    for (int x = 0; x < width_; ++x, from += side, to += padded_) {
      for (std::size_t first = 0; first < padded_; first += kAtOnce)
        add_row(from + first, to + first);
    }
  }
  static void add_row(const std::uint16_t* __restrict from, std::uint16_t* __restrict to) {
    for (std::size_t y = 0; y < kAtOnce; ++y) to[y] = static_cast<std::uint16_t>(to[y] + from[y]);
  }

  int yaws_, n_, width_;
  /// Of a row: numbers behind its `width_` are never read.
  std::size_t padded_;
  std::vector<std::uint16_t> hits_;
};

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
    best.push_back(top);
    std::erase_if(all, [&](const Hypothesis& h) { return same_place(h, top); });
    if (best.size() < count) continue;
    const double least = kAlikeShare * best.front().score;
    std::erase_if(all, [&](const Hypothesis& h) {
      return h.score < least ||
             std::any_of(best.begin(), best.end(), [&](const auto& b) { return are_near(h, b); });
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
  Hits hits(yaws, n);
  hits.count(columns, points, centre);
  std::vector<Hypothesis> all;
  all.reserve(static_cast<std::size_t>((2 * yaws + 1) * (2 * n + 1) * (2 * n + 1)));
  for (int yaw = -yaws; yaw <= yaws; ++yaw) {
    for (int x = -n; x <= n; ++x) {
      for (int y = -n; y <= n; ++y) {
        Hypothesis h{yaw, x, y, 0.0, hits.at(yaw, x, y)};
        h.score = h.hits - kTieShare * static_cast<double>(points.size()) * away2(h) / farthest;
        all.push_back(h);
      }
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
    std::vector<Eigen::Vector3f> turned(level_points.size());
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
