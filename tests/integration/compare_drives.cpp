// Says how two drives differ, to the bit: scans, stamps, poses.
// usage: compare_drives DRIVE DRIVE      Each as `maps::Drive::open` takes it; 0 = they are the
// same.
#include <stillmap/maps/drive.hpp>

#include <cstdio>
#include <cstring>
#include <exception>
#include <vector>

namespace {

using namespace stillmap;

template <typename Value>
bool same_bits(const std::vector<Value>& a, const std::vector<Value>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Value)) == 0);
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
  if (count != 3) {
    std::fprintf(stderr, "usage: compare_drives DRIVE DRIVE\n");
    return 2;
  }
  try {
    const maps::Drive a = maps::Drive::open(words[1]);
    const char* const what = difference(a, maps::Drive::open(words[2]));
    std::printf("%zu scans, %s%s\n", a.size(),
                what == nullptr ? "no difference" : "other: ", what == nullptr ? "" : what);
    return what == nullptr ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
