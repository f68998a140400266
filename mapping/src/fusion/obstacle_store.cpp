#include "fusion/obstacle_store.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>
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

ObstacleStore::ObstacleStore(std::filesystem::path scratch_file) : file_(std::move(scratch_file)) {}

ObstacleStore::~ObstacleStore() {
  std::error_code ignored;
  if (scratch_) std::filesystem::remove(file_, ignored);
}

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
  if (!scratch_) scratch_.reset(std::fopen(file_.c_str(), "w+b"));
  if (!scratch_ ||
      std::fwrite(obstacles.data(), sizeof(Stored), obstacles.size(), scratch_.get()) !=
          obstacles.size() ||
      std::fflush(scratch_.get()) != 0)
    throw maps::StorageError(file_.string(), std::strerror(errno));
  parts_[last_drive_] = {written_bytes_, obstacles.size()};
  written_bytes_ += obstacles.size() * sizeof(Stored);
}

std::shared_ptr<const ObstacleMap> ObstacleStore::read(std::size_t drive) const {
  if (last_ && drive == last_drive_) return last_;
  const Part& part = parts_.at(drive);
  std::vector<Stored> obstacles(part.obstacles);
  const std::size_t bytes = part.obstacles * sizeof(Stored);
  for (std::size_t done = 0; done < bytes;) {
    const ssize_t got =
        ::pread(::fileno(scratch_.get()), reinterpret_cast<char*>(obstacles.data()) + done,
                bytes - done, static_cast<off_t>(part.offset_bytes + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
    if (got == 0)
      throw maps::StorageError(
          file_.string(),
          fmt::format("ends at byte {}, expected {}", part.offset_bytes + done, written_bytes_));
    done += static_cast<std::size_t>(got);
  }
  return std::make_shared<const ObstacleMap>(restored(obstacles));
}

}  // namespace stillmap::mapping
