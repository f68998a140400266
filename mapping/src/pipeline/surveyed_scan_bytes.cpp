#include "pipeline/surveyed_scan_bytes.hpp"

#include "core/byte_reader.hpp"

#include <algorithm>
#include <type_traits>
#include <utility>

namespace stillmap::mapping {
namespace {

template <typename Number>
  requires std::is_arithmetic_v<Number> || std::is_enum_v<Number>
void put(std::string& bytes, Number value) {
  put_number(bytes, value);
}

void put(std::string& bytes, std::string_view text) {
  put(bytes, text.size());
  bytes.append(text);
}

template <typename Scalar>
void put(std::string& bytes, const Eigen::Matrix<Scalar, 3, 1>& v) {
  for (const Scalar value : v) put(bytes, value);
}

void put(std::string& bytes, const std::vector<bool>& flags) {
  put(bytes, flags.size());
  for (std::size_t i = 0; i < flags.size(); i += 8) {
    unsigned packed = 0;
    for (std::size_t k = i; k < std::min(i + 8, flags.size()); ++k)
      packed |= (flags[k] ? 1U : 0U) << (k - i);
    put(bytes, static_cast<std::uint8_t>(packed));
  }
}

template <typename... Fields>
void put_each(std::string& bytes, const Fields&... fields) {
  (put(bytes, fields), ...);
}

// Taken apart by structured bindings: a field that is added stops these from compiling.

void put(std::string& bytes, const maps::Box& box) {
  const auto& [centre, size_m, yaw_rad, object_class, score, track] = box;
  put_each(bytes, centre, size_m, yaw_rad, object_class, score, track);
}

void put(std::string& bytes, const GroundCells::Cell& cell) {
  const auto& [x, y, z, offset_x, offset_y, weight, in_box] = cell;
  put_each(bytes, x, y, z, offset_x, offset_y, weight, in_box);
}

void put(std::string& bytes, const ScanObstacles::Voxel& voxel) {
  const auto& [key, sum, points] = voxel;
  put_each(bytes, key, sum, points);
}

template <typename Number>
void put(std::string& bytes, const std::pair<const std::string, Number>& named) {
  put(bytes, std::string_view(named.first));
  put(bytes, named.second);
}

template <typename All>
void put_all(std::string& bytes, const All& all) {
  put(bytes, all.size());
  for (const auto& each : all) put(bytes, each);
}

class Reader : public ByteReader {
 public:
  explicit Reader(std::string_view bytes) : ByteReader(bytes, "surveyed scan") {}

  void get(bool& value) {
    const auto byte = number<std::uint8_t>();
    if (byte > 1) refuse("a flag that is neither 0 nor 1");
    value = byte == 1;
  }
  template <typename Number>
    requires std::is_arithmetic_v<Number>
  void get(Number& value) {
    value = number<Number>();
  }
  void get(maps::ObjectClass& value) {
    using Number = std::underlying_type_t<maps::ObjectClass>;
    const auto found = number<Number>();
    if (found < 0 || found > static_cast<Number>(maps::ObjectClass::kUnknown))
      refuse("a class that is none");
    value = static_cast<maps::ObjectClass>(found);
  }
  template <typename Scalar>
  void get(Eigen::Matrix<Scalar, 3, 1>& v) {
    for (Scalar& value : v) get(value);
  }
  void get(std::string& text) { text = take(count(1)); }
  void get(std::vector<bool>& flags) {
    const auto size = number<std::size_t>();
    // Not (size + 7) / 8, which may wrap around.
    const std::string_view packed = take(size / 8 + (size % 8 == 0 ? 0 : 1));
    flags.resize(size);
    for (std::size_t i = 0; i < size; ++i)
      flags[i] = (static_cast<unsigned char>(packed[i / 8]) >> (i % 8) & 1U) != 0;
  }
  void get(maps::Box& box) {
    auto& [centre, size_m, yaw_rad, object_class, score, track] = box;
    get_each(centre, size_m, yaw_rad, object_class, score, track);
  }
  void get(GroundCells::Cell& cell) {
    auto& [x, y, z, offset_x, offset_y, weight, in_box] = cell;
    get_each(x, y, z, offset_x, offset_y, weight, in_box);
  }
  void get(ScanObstacles::Voxel& voxel) {
    auto& [key, sum, points] = voxel;
    get_each(key, sum, points);
  }
  template <typename Each>
  void get_all(std::vector<Each>& all) {
    all.resize(count(kLeastBytes));
    for (Each& each : all) get(each);
  }
  template <typename Number>
  void get_all(std::map<std::string, Number>& all) {
    for (std::size_t left = count(kLeastBytes); left > 0; --left) {
      std::string name;
      get(name);
      get(all[name]);
    }
  }
  template <typename... Fields>
  void get_each(Fields&... fields) {
    (get(fields), ...);
  }

 private:
  /// No element of a list takes fewer bytes, and none takes more than some 100 in memory.
  static constexpr std::size_t kLeastBytes = 16;
};

}  // namespace

std::string to_bytes(const SurveyedScan& surveyed) {
  const auto& [scan, sha256, is_ground, weather, boxes, ground, obstacles, view, counts, seconds] =
      surveyed;
  const auto& [cells] = ground;
  const auto& [voxels] = obstacles;
  std::string bytes;
  put_each(bytes, scan, std::string_view(sha256), is_ground, weather);
  put_all(bytes, boxes);
  put_all(bytes, cells);
  put_all(bytes, voxels);
  put(bytes, std::string_view(view.value().to_bytes()));
  put_all(bytes, counts);
  put_all(bytes, seconds);
  return bytes;
}

SurveyedScan surveyed_scan_from(std::string_view bytes) {
  Reader reader(bytes);
  SurveyedScan scan;
  std::string view;
  reader.get_each(scan.scan, scan.sha256, scan.is_ground, scan.weather);
  reader.get_all(scan.boxes);
  reader.get_all(scan.ground_cells.cells);
  reader.get_all(scan.obstacles.voxels);
  reader.get(view);
  reader.get_all(scan.counts);
  reader.get_all(scan.stage_seconds);
  reader.end();
  scan.view = RangeView::from_bytes(view);
  return scan;
}

}  // namespace stillmap::mapping
