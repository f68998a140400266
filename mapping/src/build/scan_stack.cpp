#include "build/scan_stack.hpp"

#include <fmt/format.h>

#include <chrono>

namespace stillmap::mapping {

void ScanStack::add_points(const ProcessedScan& scan) {
  const std::size_t first = objects_.size();
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    StackedPoint point = scan.points[i];
    // The package has 8 bits for it; 0 means none, so numbers start again at 1.
    if (const std::uint32_t object = scan.object_of_point[i]; object != 0)
      point.object = static_cast<std::uint8_t>(1 + (first + object - 1) % 255);
    if (!map_.add(point)) ++counts_["dropped_beyond_grid"];
  }
}

void ScanStack::add(const ProcessedScan& scan) {
  const auto began = std::chrono::steady_clock::now();
  add_points(scan);
  objects_.insert(objects_.end(), scan.objects.begin(), scan.objects.end());
  for (const auto& [name, count] : scan.counts) counts_[name] += count;
  for (const auto& [name, seconds] : scan.stage_seconds) stage_seconds_[name] += seconds;
  poses_.push_back({drive_.stamp_ns(scan.index), drive_.T_map_lidar(scan.index)});
  sources_ += fmt::format("{}  {}\n", scan.sha256,
                          drive_.contents().scan_files[scan.index].filename().string());
  stage_seconds_["stack"] +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

}  // namespace stillmap::mapping
