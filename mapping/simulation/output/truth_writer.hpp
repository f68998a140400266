#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "geometry/mesh.hpp"
#include "output/layout_writer.hpp"
#include "sensing/simulated_scan.hpp"

namespace stillmap::simulation {

/// What no recording has, as `truth/README.md` (written along) describes it.
class TruthWriter {
 public:
  /// @throws maps::StorageError, as do all members.
  explicit TruthWriter(const std::filesystem::path& drive_folder);

  /// @param stem  name of the scan's files. @param behind  positions of `scan.behind` in the
  /// layout's convention.
  void add(const std::string& stem, const SimulatedScan& scan,
           const std::vector<Eigen::Vector3f>& behind);
  /// The true path each millisecond from half a period before the first stamp to half a period
  /// after the last; the ground in the map frame.
  void finish(const LayoutWriter& layout, const TruePath& T_world_lidar, double period_s,
              const Mesh& ground);

 private:
  std::filesystem::path folder_;
  bool any_ = false;
  double first_stamp_s_ = 0.0;
  double last_stamp_s_ = 0.0;
};

}  // namespace stillmap::simulation
