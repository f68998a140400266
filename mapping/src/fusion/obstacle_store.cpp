#include "fusion/obstacle_store.hpp"

#include <fmt/format.h>

#include <array>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::mapping {

namespace {

/// An obstacle in the file.
struct Stored {
  std::array<float, 3> position;
  std::uint32_t scans;
  std::uint32_t planarity;
};

std::vector<Stored> stored(const std::vector<Obstacle>& obstacles) {
  std::vector<Stored> out;
  out.reserve(obstacles.size());
  for (const Obstacle& each : obstacles) {
    const Eigen::Vector3f& p = each.position;
    out.push_back({{p.x(), p.y(), p.z()}, each.scans, each.planarity});
  }
  return out;
}

std::vector<Obstacle> restored(const std::vector<Stored>& stored) {
  std::vector<Obstacle> out;
  out.reserve(stored.size());
  for (const Stored& each : stored) {
    out.push_back({{each.position[0], each.position[1], each.position[2]},
                   each.scans,
                   static_cast<std::uint8_t>(each.planarity)});
  }
  return out;
}

}  // namespace

void ObstacleStore::add(std::size_t drive, const ScanObstacles& scan) {
  if (last_ && drive < last_drive_)
    throw std::invalid_argument(
        fmt::format("obstacles of drive {} after those of drive {}", drive, last_drive_));
  if (last_ && drive > last_drive_) {
    last_->finish();
    write_last();
    last_.reset();
  }
  if (!last_) last_ = std::make_shared<ObstacleMap>();
  last_drive_ = drive;
  last_->add(scan);
}

void ObstacleStore::finish() {
  if (last_) last_->finish();
}

void ObstacleStore::write_last() {
  const std::vector<Stored> obstacles = stored(last_->all());
  if (!scratch_) scratch_.emplace(folder_, "obstacles");
  parts_[last_drive_] = {scratch_->append(obstacles.data(), obstacles.size() * sizeof(Stored)),
                         obstacles.size()};
}

std::shared_ptr<const ObstacleMap> ObstacleStore::read(std::size_t drive) const {
  if (last_ && drive == last_drive_) return last_;
  const Part& part = parts_.at(drive);
  std::vector<Stored> obstacles(part.obstacles);
  scratch_->read(part.offset_bytes, obstacles.data(), part.obstacles * sizeof(Stored));
  return std::make_shared<const ObstacleMap>(restored(obstacles));
}

}  // namespace stillmap::mapping
