#include "fusion/obstacle_store.hpp"

#include "stacking/normals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <queue>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {

namespace {

/// Obstacles lie together, and normals are estimated, in squares of this; few voxels lie at a
/// border [m].
constexpr float kPatchM = 16.0F;
/// Sums of a run that are read at once.
constexpr std::size_t kReadAtOnce = 1024;

std::int32_t patch_at(float along_m) {
  return static_cast<std::int32_t>(std::floor(along_m / kPatchM));
}

/// An obstacle in the file.
struct Stored {
  std::array<float, 3> position;
  std::uint32_t scans;
  std::uint32_t planarity;
};

}  // namespace

/// Reads a sorted part of the file from its beginning to its end.
class ObstacleStore::Run {
 public:
  Run(const maps::ScratchFile& file, const Part& part) : file_(&file), part_(part) { fill(); }
  [[nodiscard]] const Sum& front() const { return read_[at_]; }
  /// @return false at the end.
  bool next() {
    if (++at_ < read_.size()) return true;
    if (part_.items == 0) return false;
    fill();
    return true;
  }

 private:
  void fill() {
    read_.resize(std::min(kReadAtOnce, part_.items));
    file_->read(part_.offset_bytes, read_.data(), read_.size() * sizeof(Sum));
    part_.offset_bytes += read_.size() * sizeof(Sum);
    part_.items -= read_.size();
    at_ = 0;
  }

  const maps::ScratchFile* file_;
  /// What is not read yet.
  Part part_;
  std::vector<Sum> read_;
  std::size_t at_ = 0;
};

maps::ScratchFile& ObstacleStore::file() {
  if (!scratch_) scratch_.emplace(folder_, "obstacles");
  return *scratch_;
}

void ObstacleStore::add(std::size_t drive, const ScanObstacles& scan) {
  if (drive_ && drive < *drive_)
    throw std::invalid_argument(
        fmt::format("obstacles of drive {} after those of drive {}", drive, *drive_));
  if (drive_ && drive > *drive_) finish_drive();
  drive_ = drive;
  for (const ScanObstacles::Voxel& voxel : scan.voxels) {
    Sum& sum = sums_[voxel.key];
    sum.x += voxel.sum.x();
    sum.y += voxel.sum.y();
    sum.z += voxel.sum.z();
    sum.points += voxel.points;
    ++sum.scans;
  }
  if (sums_.size() > most_voxels_) write_run();
}

void ObstacleStore::finish() {
  if (drive_) finish_drive();
}

void ObstacleStore::write_run() {
  std::vector<Sum> run;
  run.reserve(sums_.size());
  for (const auto& [key, sum] : sums_) {
    run.push_back(sum);
    run.back().key = key;
  }
  sums_.clear();
  std::sort(run.begin(), run.end(), [](const Sum& a, const Sum& b) { return a.key < b.key; });
  runs_.push_back({file().append(run.data(), run.size() * sizeof(Sum)), run.size()});
}

void ObstacleStore::finish_drive() {
  if (sums_.size() > 0) write_run();
  std::vector<Run> runs;
  // The smallest key is on top; of equal ones that of the earliest run.
  using Front = std::pair<std::uint64_t, std::size_t>;
  std::priority_queue<Front, std::vector<Front>, std::greater<>> fronts;
  for (const Part& part : std::exchange(runs_, {})) {
    const Run& run = runs.emplace_back(file(), part);
    fronts.emplace(run.front().key, runs.size() - 1);
  }
  // Keys ascend with x: what lies a voxel behind cannot be added to any more.
  std::map<PatchId, std::vector<Obstacle>> open;
  while (!fronts.empty()) {
    const std::uint64_t key = fronts.top().first;
    Sum sum;
    while (!fronts.empty() && fronts.top().first == key) {
      const std::size_t run = fronts.top().second;
      fronts.pop();
      const Sum& part = runs[run].front();
      sum.x += part.x;
      sum.y += part.y;
      sum.z += part.z;
      sum.points += part.points;
      sum.scans += part.scans;
      if (runs[run].next()) fronts.emplace(runs[run].front().key, run);
    }
    Obstacle obstacle;
    obstacle.position = Eigen::Vector3f(sum.x, sum.y, sum.z) / static_cast<float>(sum.points);
    obstacle.scans = sum.scans;
    const float behind_m =
        kObstacleVoxelM * static_cast<float>(maps::signed_cell_of_key(key)[0] - 1);
    while (!open.empty() && std::get<1>(open.begin()->first) < patch_at(behind_m)) {
      auto first = open.extract(open.begin());
      write_patch(first.key(), std::move(first.mapped()));
    }
    open[{*drive_, patch_at(obstacle.position.x()), patch_at(obstacle.position.y())}].push_back(
        obstacle);
  }
  for (auto& [id, obstacles] : open) write_patch(id, std::move(obstacles));
}

void ObstacleStore::write_patch(const PatchId& id, std::vector<Obstacle> obstacles) {
  std::vector<Eigen::Vector3f> positions;
  positions.reserve(obstacles.size());
  for (const Obstacle& each : obstacles) positions.push_back(each.position);
  const std::vector<SurfaceNormal> normals = estimate_normals(positions, positions);
  std::vector<Stored> stored;
  stored.reserve(obstacles.size());
  for (std::size_t i = 0; i < obstacles.size(); ++i) {
    const Eigen::Vector3f& p = positions[i];
    stored.push_back({{p.x(), p.y(), p.z()}, obstacles[i].scans, normals[i].planarity});
  }
  patches_[id].push_back(
      {file().append(stored.data(), stored.size() * sizeof(Stored)), stored.size()});
}

ObstacleMap ObstacleStore::around(std::size_t drive, const Eigen::Vector2d& centre,
                                  double radius_m) const {
  const Eigen::Array2f c = centre.cast<float>().array();
  const auto reach = static_cast<float>(radius_m);
  std::vector<Obstacle> found;
  for (std::int32_t x = patch_at(c.x() - reach); x <= patch_at(c.x() + reach); ++x) {
    for (std::int32_t y = patch_at(c.y() - reach); y <= patch_at(c.y() + reach); ++y) {
      const auto patch = patches_.find({drive, x, y});
      if (patch == patches_.end()) continue;
      for (const Part& part : patch->second) {
        std::vector<Stored> stored(part.items);
        scratch_->read(part.offset_bytes, stored.data(), stored.size() * sizeof(Stored));
        for (const Stored& each : stored) {
          found.push_back({{each.position[0], each.position[1], each.position[2]},
                           each.scans,
                           static_cast<std::uint8_t>(each.planarity)});
        }
      }
    }
  }
  return ObstacleMap(found);
}

}  // namespace stillmap::mapping
