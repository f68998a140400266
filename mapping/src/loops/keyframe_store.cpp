#include "loops/keyframe_store.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <array>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr float kCellM = 0.25F;
constexpr float kKeyframeReachM = 150.0F;
/// 150 m are 30,000 steps, so that 16 bits hold a coordinate.
constexpr float kStoredStepM = 0.005F;

using Stored = std::array<std::int16_t, 3>;

std::uint64_t keyframe_cell(const Eigen::Vector3f& p) {
  const Eigen::Array3i cell = (p / kCellM).array().floor().cast<int>();
  return maps::signed_cell_key(cell.x(), cell.y(), cell.z());
}

std::vector<Stored> packed_voxels(const std::vector<Eigen::Vector3f>& points) {
  std::vector<Stored> out;
  maps::CellTable taken(points.size() / 4);
  for (const Eigen::Vector3f& p : points) {
    if (!(p.array().abs() < kKeyframeReachM).all()) continue;
    if (!taken.insert(keyframe_cell(p)).second) continue;
    const auto step = [&](int axis) {
      return static_cast<std::int16_t>(std::lround(p[axis] / kStoredStepM));
    };
    out.push_back({step(0), step(1), step(2)});
  }
  return out;
}

}  // namespace

KeyframeStore::KeyframeStore(const std::filesystem::path& folder) : file_(folder, "keyframes") {}

void KeyframeStore::append(const std::vector<Eigen::Vector3f>& points_lidar) {
  const std::vector<Stored> points = packed_voxels(points_lidar);
  places_.push_back({file_.append(points.data(), points.size() * sizeof(Stored)), points.size()});
}

std::vector<Eigen::Vector3f> KeyframeStore::read(std::size_t keyframe) const {
  const Place& place = places_.at(keyframe);
  std::vector<Stored> stored(place.points);
  file_.read(place.offset, stored.data(), stored.size() * sizeof(Stored));
  std::vector<Eigen::Vector3f> points;
  points.reserve(stored.size());
  for (const Stored& each : stored) {
    points.emplace_back(static_cast<float>(each[0]), static_cast<float>(each[1]),
                        static_cast<float>(each[2]));
    points.back() *= kStoredStepM;
  }
  return points;
}

}  // namespace stillmap::mapping
