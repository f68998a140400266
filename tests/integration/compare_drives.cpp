// Says how two drives differ, to the bit: scans, stamps, poses.
// usage: compare_drives DRIVE DRIVE [METRES]   Each as `maps::Drive::open` takes it; 0 = they are
// the same. With METRES only the points that were kept are compared, one by one: positions within
// METRES, times within 0.3 ms.
#include <stillmap/maps/drive.hpp>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

namespace {

using namespace stillmap;

template <typename Value>
bool same_bits(const std::vector<Value>& a, const std::vector<Value>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Value)) == 0);
}

/// NaN where one is.
double farthest_m(const maps::PointCloud& a, const maps::PointCloud& b) {
  double most = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const auto apart_m = static_cast<double>((a.positions[i] - b.positions[i]).norm());
    if (!(apart_m <= most)) most = apart_m;
    if (std::isnan(most)) break;
  }
  return most;
}

/// @return what differs first; empty when nothing does.
std::string difference_within(double most_m, const maps::Drive& a, const maps::Drive& b) {
  if (!same_bits(a.contents().stamps_ns, b.contents().stamps_ns)) return "stamps";
  for (std::size_t scan = 0; scan < a.size(); ++scan) {
    const maps::PointCloud cloud_a = a.read(scan).cloud, cloud_b = b.read(scan).cloud;
    if (cloud_a.size() != cloud_b.size())
      return std::to_string(cloud_a.size()) + " and " + std::to_string(cloud_b.size()) + " points";
    if (const double apart_m = farthest_m(cloud_a, cloud_b); !(apart_m <= most_m))
      return "points that are " + std::to_string(apart_m) + " m apart";
    if (cloud_a.time_offsets_s.size() != cloud_b.time_offsets_s.size())
      return "that one has times of points";
    for (std::size_t i = 0; i < cloud_a.time_offsets_s.size(); ++i)
      if (!(std::abs(cloud_a.time_offsets_s[i] - cloud_b.time_offsets_s[i]) <= 3e-4F))
        return "times of point " + std::to_string(i);
  }
  return {};
}

/// @return what differs first; nullptr when nothing does.
const char* difference(const maps::Drive& a, const maps::Drive& b) {
  if (a.size() != b.size()) return "the number of scans";
  if (!same_bits(a.contents().stamps_ns, b.contents().stamps_ns)) return "stamps";
  if (a.relative_clock() != b.relative_clock()) return "the clock";
  if (a.has_poses() != b.has_poses()) return "that one has poses";
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a.has_poses() && a.T_map_lidar(i).matrix() != b.T_map_lidar(i).matrix()) return "poses";
    const maps::Scan scan_a = a.read(i);
    const maps::Scan scan_b = b.read(i);
    if (scan_a.stamp_ns != scan_b.stamp_ns) return "the stamp of a scan";
    if (!same_bits(scan_a.cloud.positions, scan_b.cloud.positions)) return "points";
    if (!same_bits(scan_a.cloud.intensities, scan_b.cloud.intensities)) return "intensities";
    if (!same_bits(scan_a.cloud.time_offsets_s, scan_b.cloud.time_offsets_s)) return "times";
    if (!same_bits(scan_a.cloud.file_indices, scan_b.cloud.file_indices)) return "indices";
    if (scan_a.points_in_file != scan_b.points_in_file ||
        scan_a.dropped.non_finite != scan_b.dropped.non_finite ||
        scan_a.dropped.zero_range != scan_b.dropped.zero_range)
      return "counts";
  }
  return nullptr;
}

}  // namespace

int main(int count, char** words) {
  if (count != 3 && count != 4) {
    std::fprintf(stderr, "usage: compare_drives DRIVE DRIVE [METRES]\n");
    return 2;
  }
  try {
    const maps::Drive a = maps::Drive::open(words[1]);
    if (count == 4) {
      const std::string other =
          difference_within(std::atof(words[3]), a, maps::Drive::open(words[2]));
      std::printf("%zu scans, %s\n", a.size(), other.empty() ? "no difference" : other.c_str());
      return other.empty() ? 0 : 1;
    }
    const char* const what = difference(a, maps::Drive::open(words[2]));
    std::printf("%zu scans, %s%s\n", a.size(),
                what == nullptr ? "no difference" : "other: ", what == nullptr ? "" : what);
    return what == nullptr ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
