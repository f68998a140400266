#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "rawlogs/rawlog_process.hpp"
#include "rawlogs/rawlog_record.hpp"

namespace stillmap::maps {

struct RawlogScan {
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_base_lidar = Eigen::Isometry3d::Identity();
  /// Of its points among the records.
  std::uint64_t offset = 0;
  std::uint32_t points = 0;
  std::uint32_t flags = 0;
};

/// What a rawlog holds; the scans' points and the poses stay in the file of records.
struct RawlogSurvey {
  UnnamedFile records;
  std::map<std::string, std::vector<RawlogScan>> scans_of_label;
  /// By source, see RawlogPoseSource.
  std::array<std::size_t, 3> poses{};
  /// Broken off, clouds that could not be used.
  std::vector<std::string> notes;

  /// Each pose T_odom_base of a source, in the order of the rawlog. @throws StorageError.
  void for_each_pose(RawlogPoseSource source,
                     const std::function<void(std::int64_t, const Eigen::Isometry3d&)>& take) const;
};

/// Fills the rest of a survey from its records, of which nothing is believed.
/// @param broken_off  why there are no more, if not by themselves.
void survey_records(RawlogSurvey& survey, std::string broken_off);

/// Has a rawlog read, once for each process as long as the file stays the same.
/// @throws InputError, StorageError as `read_rawlog`.
[[nodiscard]] std::shared_ptr<const RawlogSurvey> survey_rawlog(const std::filesystem::path& file);

}  // namespace stillmap::maps
