#include "build/posed_drives_bytes.hpp"

#include <cstdint>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <type_traits>
#include <utility>

namespace stillmap::mapping {
namespace {

template <typename Number>
  requires std::is_arithmetic_v<Number>
void put(std::string& bytes, Number value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}

  template <typename Number>
  [[nodiscard]] Number number() {
    Number value{};
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  [[nodiscard]] std::string_view take(std::size_t size) {
    if (size > bytes_.size()) throw std::invalid_argument("poses of drives: cut off");
    const std::string_view taken = bytes_.substr(0, size);
    bytes_.remove_prefix(size);
    return taken;
  }
  [[nodiscard]] bool at_end() const { return bytes_.empty(); }

 private:
  std::string_view bytes_;
};

maps::Drive drive_from(Reader& reader, const maps::Drive& drive) {
  std::optional<maps::GeodeticOrigin> origin;
  if (reader.number<std::uint8_t>() != 0) {
    origin.emplace();
    origin->latitude_deg = reader.number<double>();
    origin->longitude_deg = reader.number<double>();
    origin->altitude_m = reader.number<double>();
  }
  std::vector<Eigen::Isometry3d> poses(drive.size(), Eigen::Isometry3d::Identity());
  for (Eigen::Isometry3d& T : poses) {
    for (Eigen::Index row = 0; row < 3; ++row) {
      for (Eigen::Index column = 0; column < 4; ++column)
        T.matrix()(row, column) = reader.number<double>();
    }
  }
  return drive.with_poses(std::move(poses), origin);
}

}  // namespace

std::string to_bytes(const PosedDrives& posed) {
  std::string bytes;
  put(bytes, posed.counts.size());
  for (const auto& [name, count] : posed.counts) {
    put(bytes, name.size());
    bytes.append(name);
    put(bytes, count);
  }
  put(bytes, posed.drives.size());
  for (const maps::Drive& drive : posed.drives) {
    const auto& origin = drive.contents().origin;
    put(bytes, static_cast<std::uint8_t>(origin.has_value()));
    if (origin) {
      put(bytes, origin->latitude_deg);
      put(bytes, origin->longitude_deg);
      put(bytes, origin->altitude_m);
    }
    for (const Eigen::Isometry3d& T : drive.contents().T_map_lidar) {
      for (Eigen::Index row = 0; row < 3; ++row) {
        for (Eigen::Index column = 0; column < 4; ++column) put(bytes, T.matrix()(row, column));
      }
    }
  }
  return bytes;
}

PosedDrives posed_drives_from(std::string_view bytes, const std::vector<maps::Drive>& drives) {
  Reader reader(bytes);
  PosedDrives posed;
  for (auto left = reader.number<std::size_t>(); left > 0; --left) {
    const std::string name(reader.take(reader.number<std::size_t>()));
    posed.counts[name] = reader.number<std::uint64_t>();
  }
  if (reader.number<std::size_t>() != drives.size())
    throw std::invalid_argument("poses of drives: of another number of drives");
  for (const maps::Drive& drive : drives) posed.drives.push_back(drive_from(reader, drive));
  if (!reader.at_end()) throw std::invalid_argument("poses of drives: bytes behind the last one");
  return posed;
}

}  // namespace stillmap::mapping
