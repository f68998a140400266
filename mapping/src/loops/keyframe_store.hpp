#pragma once

#include <stillmap/maps/scratch_file.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace stillmap::mapping {

/// The points of all keyframes, thinned, in a scratch file: memory holds 16 bytes a keyframe.
///
/// One point a cell of 0.25 m (the first), within 150 m, in steps of 5 mm: six bytes a point, some
/// 100 KB a keyframe of a 64-beam sensor.
class KeyframeStore {
 public:
  /// Makes a scratch file of its own in `folder`; it is removed with the store.
  /// @throws maps::StorageError naming the file.
  explicit KeyframeStore(const std::filesystem::path& folder);

  /// Gives the next number to a keyframe. Not while another thread is in any other function.
  /// @param points_lidar  [m]; those that are not finite or too far are left out.
  /// @throws maps::StorageError naming the file, e.g. on a full disk; the store is unchanged then.
  void append(const std::vector<Eigen::Vector3f>& points_lidar);

  [[nodiscard]] std::size_t size() const { return places_.size(); }
  [[nodiscard]] std::size_t points_of(std::size_t keyframe) const {
    return places_.at(keyframe).points;
  }
  [[nodiscard]] const std::filesystem::path& file() const { return file_.path(); }

  /// Safe from several threads.
  /// @throws std::out_of_range; maps::StorageError naming the file when it cannot be read or ends
  /// too early.
  [[nodiscard]] std::vector<Eigen::Vector3f> read(std::size_t keyframe) const;

 private:
  struct Place {
    std::uint64_t offset = 0;
    std::uint64_t points = 0;
  };

  maps::ScratchFile file_;
  std::vector<Place> places_;
};

}  // namespace stillmap::mapping
