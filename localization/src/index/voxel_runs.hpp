#pragma once

#include "cell_blocks.hpp"
#include "voxel.hpp"

#include <stillmap/maps/scratch_vector.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <vector>

namespace stillmap::localization {

/// The voxels of a region, added in sorted runs, and visited by level in the order of all. They lie
/// in scratch files: memory holds what is being added or visited.
class VoxelRuns {
 public:
  using Place = CellBlocks::Place;

  /// @param folder  as of `maps::ScratchPieces`.
  explicit VoxelRuns(const std::filesystem::path& folder) : places_(folder), voxels_(folder) {}

  void begin_run(std::size_t level) {
    rest();
    runs_.push_back({level, voxels_.size(), voxels_.size()});
  }
  /// To the run that was begun last. @param place  after those before in this run, and in no other
  /// run of the level. @throws as `maps::ScratchPieces::add`.
  void add(const Place& place, const Voxel& voxel) {
    places_.push_back(place);
    voxels_.push_back(voxel);
    ++runs_.back().end;
  }

  /// Of all levels.
  [[nodiscard]] bool empty() const { return voxels_.empty(); }
  /// Of a level.
  [[nodiscard]] std::size_t size(std::size_t level) const {
    std::size_t size = 0;
    for (const Run& run : runs_of(level)) size += run.end - run.begin;
    return size;
  }
  /// Calls `visit(place, voxel)` for the voxels of a level, by place.
  template <typename Visit>
  void for_each(std::size_t level, const Visit& visit) const {
    std::vector<Run> left = runs_of(level);
    std::size_t visited = 0;
    while (!left.empty()) {
      std::sort(left.begin(), left.end(),
                [&](const Run& a, const Run& b) { return places_[a.begin] < places_[b.begin]; });
      Run& first = left.front();
      do {
        visit(places_[first.begin], voxels_[first.begin]);
        if (++visited % kVisitedAtOnce == 0) rest();
      } while (++first.begin < first.end &&
               (left.size() == 1 || places_[first.begin] < places_[left[1].begin]));
      if (first.begin == first.end) left.erase(left.begin());
    }
    rest();
  }

 private:
  /// Some megabytes.
  static constexpr std::size_t kVisitedAtOnce = std::size_t{1} << 15;

  struct Run {
    std::size_t level;
    /// Numbers of the first voxel and of the one behind the last.
    std::size_t begin, end;
  };
  /// Those that are not empty.
  [[nodiscard]] std::vector<Run> runs_of(std::size_t level) const {
    std::vector<Run> runs;
    for (const Run& run : runs_)
      if (run.level == level && run.begin < run.end) runs.push_back(run);
    return runs;
  }
  void rest() const {
    places_.rest();
    voxels_.rest();
  }

  maps::ScratchVector<Place> places_;
  maps::ScratchVector<Voxel> voxels_;
  std::vector<Run> runs_;
};

}  // namespace stillmap::localization
