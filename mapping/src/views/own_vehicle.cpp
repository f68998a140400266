#include "views/own_vehicle.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace stillmap::mapping {
namespace {

constexpr float kCubeM = 0.25F;
constexpr float kVehicleReachM = 12.0F;
constexpr std::size_t kFewestSamples = 6;
constexpr std::size_t kSamples = 12;
constexpr double kBeforeM = 10.0;
constexpr double kLeastWayM = 40.0;
/// Of the samples.
constexpr double kAlwaysTaken = 0.75;
constexpr double kSometimesTaken = 0.1;
/// Of a cube's points that an earlier view says anything about.
constexpr double kMostHits = 0.1;
constexpr std::uint32_t kFewestFree = 3;
/// Fewer are chance; the front of a trailer has 60.
constexpr std::size_t kFewestCubes = 8;
/// Of a point, as it is looked at.
constexpr float kLookRadiusM = 0.06F;
constexpr float kNearestViewM = 2.0F;

Eigen::Vector3i cube_of(const Eigen::Vector3f& p) {
  return (p / kCubeM).array().floor().cast<int>();
}

std::uint64_t cube_key(const Eigen::Vector3i& c) {
  return maps::signed_cell_key(c.x(), c.y(), c.z());
}

bool in_vehicle_reach(const Eigen::Vector3f& p) {
  return p.squaredNorm() < kVehicleReachM * kVehicleReachM;
}

struct CubeRecord {
  Eigen::Vector3i cube = Eigen::Vector3i::Zero();
  std::uint32_t samples = 0, free = 0, hit = 0;
  std::size_t last_sample = SIZE_MAX;

  [[nodiscard]] bool seen_free() const {
    return free >= kFewestFree && hit <= kMostHits * static_cast<double>(free + hit);
  }
  [[nodiscard]] bool taken(double share, std::size_t of) const {
    return static_cast<double>(samples) >= share * static_cast<double>(of);
  }
};

}  // namespace

std::vector<std::pair<std::size_t, std::size_t>> OwnVehicle::choose_samples(
    std::span<const Eigen::Isometry3d> T_local_lidar) {
  std::vector<double> way_m(T_local_lidar.size());
  for (std::size_t i = 1; i < way_m.size(); ++i)
    way_m[i] =
        way_m[i - 1] + (T_local_lidar[i].translation() - T_local_lidar[i - 1].translation()).norm();
  std::vector<std::pair<std::size_t, std::size_t>> samples;
  if (way_m.empty() || way_m.back() < kLeastWayM) return samples;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const double at_m = kBeforeM + (way_m.back() - kBeforeM) * static_cast<double>(k) / kSamples;
    const auto scan = std::lower_bound(way_m.begin(), way_m.end(), at_m);
    const auto before = std::upper_bound(way_m.begin(), scan, *scan - kBeforeM);
    if (before == way_m.begin()) continue;
    const std::pair<std::size_t, std::size_t> sample(scan - way_m.begin(),
                                                     before - way_m.begin() - 1);
    if (samples.empty() || samples.back() != sample) samples.push_back(sample);
  }
  // One that is asked several times tells no more than once.
  if (samples.size() < kFewestSamples) samples.clear();
  return samples;
}

OwnVehicle::OwnVehicle(std::span<const Sample> samples) {
  // In the order of the keys, so that what follows does not depend on a hash.
  std::map<std::uint64_t, CubeRecord> records;
  for (std::size_t k = 0; k < samples.size(); ++k) {
    for (const Eigen::Vector3f& p : samples[k].positions) {
      if (!in_vehicle_reach(p)) continue;
      const Eigen::Vector3i cube = cube_of(p);
      CubeRecord& record = records[cube_key(cube)];
      record.cube = cube;
      if (record.last_sample != k) ++record.samples;
      record.last_sample = k;
    }
  }
  std::erase_if(records, [&](const auto& each) {
    return !each.second.taken(kSometimesTaken, samples.size());
  });
  for (const Sample& sample : samples) {
    const Eigen::Isometry3f T_before_lidar = sample.T_before_lidar.cast<float>();
    for (const Eigen::Vector3f& p : sample.positions) {
      if (!in_vehicle_reach(p)) continue;
      const auto record = records.find(cube_key(cube_of(p)));
      const Eigen::Vector3f p_before = T_before_lidar * p;
      if (record == records.end() || p_before.norm() < kNearestViewM) continue;
      const Sight sight = sample.before.look(p_before, kLookRadiusM).sight;
      record->second.free += sight == Sight::kFree ? 1 : 0;
      record->second.hit += sight == Sight::kHit ? 1 : 0;
    }
  }
  std::vector<std::uint64_t> border;
  for (const auto& [key, record] : records) {
    if (record.taken(kAlwaysTaken, samples.size()) && record.seen_free()) border.push_back(key);
  }
  if (border.size() < kFewestCubes) return;
  for (const std::uint64_t cube : border) cubes_.insert(cube);
  while (!border.empty()) {
    const Eigen::Vector3i cube = records.at(border.back()).cube;
    border.pop_back();
    for (int n = 0; n < 27; ++n) {
      const auto beside =
          records.find(cube_key(cube + Eigen::Vector3i(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)));
      if (beside == records.end() || !beside->second.seen_free()) continue;
      if (cubes_.insert(beside->first).second) border.push_back(beside->first);
    }
  }
}

bool OwnVehicle::holds(const Eigen::Vector3f& p) const {
  return !empty() && in_vehicle_reach(p) && cubes_.contains(cube_key(cube_of(p)));
}

}  // namespace stillmap::mapping
