#pragma once

#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/odometry_evaluation.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace stillmap::mapping {

/// Scans as odometry is to see them: as they are, or with movable points projected or deleted as
/// `--preset paper` does, each scan on its own.
///
/// Nothing is deskewed before: odometry does that with its own motion. Boxes and ground are found
/// in the sweep as it was measured.
class TreatedScans {
 public:
  /// @param drive  must outlive this.
  /// @param scans  those that will be read; some of them teach the ground stage.
  /// @throws as `make_detector`, and what reading a scan throws; Cancelled.
  TreatedScans(const maps::Drive& drive, MovablePolicy policy, const std::string& detector,
               std::span<const std::size_t> scans, const CancelFlag& cancel);

  /// @note  Safe from several threads.
  [[nodiscard]] maps::Scan read(std::size_t index) const;
  /// Of all scans read so far, each counted once: odometry reads the first ones twice.
  [[nodiscard]] TreatedPoints points() const;

 private:
  const maps::Drive& drive_;
  MovablePolicy policy_;
  /// None where everything is kept.
  std::unique_ptr<GroundSegmenter> ground_;
  std::unique_ptr<Detector> detector_;
  /// One a scan of the drive.
  mutable std::vector<std::atomic<bool>> counted_;
  mutable std::atomic<std::uint64_t> in_ = 0, projected_ = 0, deleted_ = 0;
};

}  // namespace stillmap::mapping
