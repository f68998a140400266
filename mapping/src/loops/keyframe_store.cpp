#include "loops/keyframe_store.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>
#include <unordered_set>

namespace stillmap::mapping {
namespace {

constexpr float kCellM = 0.25F;
constexpr float kReachM = 150.0F;
/// 150 m are 30,000 steps, so that 16 bits hold a coordinate.
constexpr float kStepM = 0.005F;

using Stored = std::array<std::int16_t, 3>;

std::uint64_t cell_key(const Eigen::Vector3f& p) {
  const Eigen::Array3i cell = (p / kCellM).array().floor().cast<int>() + 1024;
  return static_cast<std::uint64_t>(cell.x()) << 32 | static_cast<std::uint64_t>(cell.y()) << 16 |
         static_cast<std::uint64_t>(cell.z());
}

std::vector<Stored> thinned(const std::vector<Eigen::Vector3f>& points) {
  std::vector<Stored> out;
  std::unordered_set<std::uint64_t> taken;
  taken.reserve(points.size() / 4);
  for (const Eigen::Vector3f& p : points) {
    if (!(p.array().abs() < kReachM).all()) continue;
    if (!taken.insert(cell_key(p)).second) continue;
    const auto step = [&](int axis) {
      return static_cast<std::int16_t>(std::lround(p[axis] / kStepM));
    };
    out.push_back({step(0), step(1), step(2)});
  }
  return out;
}

}  // namespace

KeyframeStore::KeyframeStore(const std::filesystem::path& folder) {
  std::string name = (folder / "keyframes.XXXXXX").string();
  descriptor_ = ::mkstemp(name.data());
  if (descriptor_ < 0) throw maps::StorageError(name, std::strerror(errno));
  file_ = name;
}

KeyframeStore::~KeyframeStore() {
  ::close(descriptor_);
  std::error_code ignored;
  std::filesystem::remove(file_, ignored);
}

void KeyframeStore::append(const std::vector<Eigen::Vector3f>& points_lidar) {
  const std::vector<Stored> points = thinned(points_lidar);
  const std::size_t bytes = points.size() * sizeof(Stored);
  for (std::size_t done = 0; done < bytes;) {
    const ssize_t written =
        ::pwrite(descriptor_, reinterpret_cast<const char*>(points.data()) + done, bytes - done,
                 static_cast<off_t>(end_ + done));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
    if (written == 0) throw maps::StorageError(file_.string(), "nothing could be written");
    done += static_cast<std::size_t>(written);
  }
  places_.push_back({end_, points.size()});
  end_ += bytes;
}

std::vector<Eigen::Vector3f> KeyframeStore::read(std::size_t keyframe) const {
  const Place& place = places_.at(keyframe);
  std::vector<Stored> stored(place.points);
  const std::size_t bytes = place.points * sizeof(Stored);
  for (std::size_t done = 0; done < bytes;) {
    const ssize_t got = ::pread(descriptor_, reinterpret_cast<char*>(stored.data()) + done,
                                bytes - done, static_cast<off_t>(place.offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
    if (got == 0)
      throw maps::StorageError(
          file_.string(), fmt::format("ends at byte {}, expected {}", place.offset + done, end_));
    done += static_cast<std::size_t>(got);
  }
  std::vector<Eigen::Vector3f> points;
  points.reserve(stored.size());
  for (const Stored& each : stored) {
    points.emplace_back(static_cast<float>(each[0]), static_cast<float>(each[1]),
                        static_cast<float>(each[2]));
    points.back() *= kStepM;
  }
  return points;
}

}  // namespace stillmap::mapping
