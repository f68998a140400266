#include "package/tile_bytes.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>

namespace stillmap::maps {
namespace {

constexpr std::uint32_t kMostSteps = 65536;
/// Points higher above the base have their steps in a list of their own.
constexpr std::int64_t kMostHeightSteps = 65536;

/// 524 km: no float may carry a height out of its 32 bits.
constexpr std::int32_t kMostTallSteps = 1 << 30;

enum TileFlag : std::uint32_t { kHasHistory = 1, kWideScanRows = 2, kWideObjectRows = 4 };

/// The first bytes of a tile.
struct TileHead {
  std::uint32_t points = 0;
  std::uint32_t flags = 0;
  std::int32_t z_base_m = 0;
  /// Points beyond 65,536 steps above the base.
  std::uint32_t tall = 0;
  /// Points that belong to an object.
  std::uint32_t of_objects = 0;
  /// Scans that the histories name, and objects that points belong to.
  std::uint32_t scans = 0;
  std::uint32_t objects = 0;
  /// Drives that the evidence tells of.
  std::uint32_t drives = 0;
};
static_assert(sizeof(TileHead) == 32);

constexpr std::size_t kCubeBytes = TileEvidence::kCubes / 8;

/// Where each column of a tile begins, in their order; each at a multiple of 8.
struct Columns {
  explicit Columns(const TileHead& head) {
    const std::uint64_t n = head.points;
    const bool has_history = (head.flags & kHasHistory) != 0;
    const std::uint64_t scan_bytes = (head.flags & kWideScanRows) != 0 ? 4 : 2;
    const std::uint64_t object_bytes = (head.flags & kWideObjectRows) != 0 ? 4 : 2;
    end = sizeof(TileHead);
    x = take(2 * n);
    y = take(2 * n);
    z = take(2 * n);
    intensity = take(2 * n);
    observations = take(2 * n);
    kind = take(n);
    tall_index = take(4 * std::uint64_t{head.tall});
    tall_steps = take(4 * std::uint64_t{head.tall});
    object_index = take(4 * std::uint64_t{head.of_objects});
    object = take(object_bytes * head.of_objects);
    object_drive = take(4 * std::uint64_t{head.objects});
    object_number = take(4 * std::uint64_t{head.objects});
    normal = take(has_history ? 3 * n : 0);
    planarity = take(has_history ? n : 0);
    scan_drive = take(4 * std::uint64_t{head.scans});
    scan_number = take(4 * std::uint64_t{head.scans});
    first = take(has_history ? scan_bytes * n : 0);
    last = take(has_history ? scan_bytes * n : 0);
    evidence_base = take(head.drives > 0 ? 4 : 0);
    evidence_drive = take(4 * std::uint64_t{head.drives});
    free = take(kCubeBytes * head.drives);
    hit = take(kCubeBytes * head.drives);
  }

  std::uint64_t take(std::uint64_t bytes) {
    const std::uint64_t begin = end;
    end += (bytes + 7) / 8 * 8;
    return begin;
  }

  std::uint64_t x = 0, y = 0, z = 0, intensity = 0, observations = 0, kind = 0;
  std::uint64_t tall_index = 0, tall_steps = 0;
  std::uint64_t object_index = 0, object = 0, object_drive = 0, object_number = 0;
  std::uint64_t normal = 0, planarity = 0, scan_drive = 0, scan_number = 0, first = 0, last = 0;
  std::uint64_t evidence_base = 0, evidence_drive = 0, free = 0, hit = 0;
  std::uint64_t end = 0;
};

std::uint16_t tile_step_of(double value_m) {
  const double step = std::floor(value_m / kTileStepM);
  return static_cast<std::uint16_t>(std::clamp(step, 0.0, kMostSteps - 1.0));
}

std::int32_t height_step_of(double value_m) {
  const double step = std::floor(value_m / kTileStepZM);
  if (!(std::abs(step) <= kMostTallSteps))
    throw std::invalid_argument("a point " + std::to_string(value_m) + " m above its tile's base");
  return static_cast<std::int32_t>(step);
}

float middle_of(std::uint16_t step) { return static_cast<float>((step + 0.5) * kTileStepM); }

float height_of(std::int32_t step) { return static_cast<float>((step + 0.5) * kTileStepZM); }

bool is_tall(std::int32_t step) { return step < 0 || step >= kMostHeightSteps; }

/// 11 bits of mantissa; beyond its range the nearest that it has.
Eigen::half half_of(float value) {
  const float most = static_cast<float>(Eigen::NumTraits<Eigen::half>::highest());
  return Eigen::half(std::clamp(value, -most, most));
}

/// The bytes of a tile in which columns are written.
class TileWriter {
 public:
  explicit TileWriter(std::uint64_t size) : bytes_(size) {}
  template <typename Number>
  void put(std::uint64_t column, std::size_t i, Number value) {
    std::memcpy(bytes_.data() + column + i * sizeof(Number), &value, sizeof(Number));
  }
  [[nodiscard]] std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  std::vector<std::byte> bytes_;
};

/// Columns within bytes whose size has been checked.
class TileReader {
 public:
  explicit TileReader(std::span<const std::byte> bytes) : bytes_(bytes) {}
  template <typename Number>
  [[nodiscard]] Number at(std::uint64_t column, std::size_t i) const {
    Number value;
    std::memcpy(&value, bytes_.data() + column + i * sizeof(Number), sizeof(Number));
    return value;
  }

 private:
  std::span<const std::byte> bytes_;
};

/// Scans or objects that a tile names, each once, in ascending order.
class NamedRows {
 public:
  explicit NamedRows(const std::vector<DriveNumber>& named) {
    rows_.reserve(named.size());
    for (const DriveNumber& each : named) rows_.push_back(key_of(each));
    std::sort(rows_.begin(), rows_.end());
    rows_.erase(std::unique(rows_.begin(), rows_.end()), rows_.end());
  }

  [[nodiscard]] std::uint32_t size() const { return static_cast<std::uint32_t>(rows_.size()); }
  /// Whether rows need more than 16 bits.
  [[nodiscard]] bool is_wide() const { return rows_.size() > kMostSteps; }
  void write_table(std::uint64_t drives, std::uint64_t numbers, TileWriter& out) const {
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      out.put(drives, k, static_cast<std::uint32_t>(rows_[k] >> 32U));
      out.put(numbers, k, static_cast<std::uint32_t>(rows_[k]));
    }
  }
  void write_row(std::uint64_t column, std::size_t i, DriveNumber named, TileWriter& out) const {
    const auto row = std::lower_bound(rows_.begin(), rows_.end(), key_of(named)) - rows_.begin();
    if (is_wide()) {
      out.put(column, i, static_cast<std::uint32_t>(row));
    } else {
      out.put(column, i, static_cast<std::uint16_t>(row));
    }
  }

 private:
  /// Ascends as the number does, and is compared faster.
  static std::uint64_t key_of(DriveNumber number) {
    return std::uint64_t{number.drive} << 32U | number.number;
  }
  std::vector<std::uint64_t> rows_;
};

NamedRows scans_of(const TileContent& tile) {
  std::vector<DriveNumber> scans;
  scans.reserve(2 * tile.history.size());
  for (const TilePointHistory& each : tile.history) {
    scans.push_back(each.first);
    scans.push_back(each.last);
  }
  return NamedRows(scans);
}

NamedRows objects_of(const TileContent& tile) {
  std::vector<DriveNumber> objects;
  objects.reserve(tile.of_objects.size());
  for (const TilePointOfObject& each : tile.of_objects) objects.push_back(each.object);
  return NamedRows(objects);
}

void require_encodable(const TileContent& tile) {
  const auto fail = [](const std::string& what) {
    throw std::invalid_argument("a tile with " + what);
  };
  if (tile.points.empty()) fail("no points");
  if (tile.points.size() > std::numeric_limits<std::uint32_t>::max()) fail("more than 2^32 points");
  if (!tile.history.empty() && tile.history.size() != tile.points.size())
    fail(fmt::format("{} points and {} histories", tile.points.size(), tile.history.size()));
  std::int64_t before = -1;
  for (const TilePointOfObject& each : tile.of_objects) {
    if (each.point <= before || each.point >= tile.points.size())
      fail(fmt::format("an object of point {} after {}", each.point, before));
    before = each.point;
  }
  before = -1;
  for (const TileEvidence::OfDrive& each : tile.evidence.drives) {
    if (each.drive <= before)
      fail(fmt::format("evidence of drive {} after {}", each.drive, before));
    before = each.drive;
  }
  for (const MapPoint& p : tile.points) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z) ||
        !std::isfinite(p.intensity))
      fail("a number that is not finite");
    if (p.kind > PointKind::kFilled) fail("a point of no kind");
  }
}

void write_points(const TileContent& tile, const Columns& columns, TileWriter& out) {
  std::size_t tall = 0;
  for (std::size_t i = 0; i < tile.points.size(); ++i) {
    const MapPoint& p = tile.points[i];
    out.put(columns.x, i, tile_step_of(p.x));
    out.put(columns.y, i, tile_step_of(p.y));
    const std::int32_t step = height_step_of(p.z);
    if (is_tall(step)) {
      out.put(columns.tall_index, tall, static_cast<std::uint32_t>(i));
      out.put(columns.tall_steps, tall++, step);
    } else {
      out.put(columns.z, i, static_cast<std::uint16_t>(step));
    }
    out.put(columns.intensity, i, half_of(p.intensity));
    out.put(columns.observations, i, p.observations);
    out.put(columns.kind, i, p.kind);
  }
}

void write_objects(const TileContent& tile, const NamedRows& objects, const Columns& columns,
                   TileWriter& out) {
  for (std::size_t i = 0; i < tile.of_objects.size(); ++i) {
    out.put(columns.object_index, i, tile.of_objects[i].point);
    objects.write_row(columns.object, i, tile.of_objects[i].object, out);
  }
  objects.write_table(columns.object_drive, columns.object_number, out);
}

void write_history(const TileContent& tile, const NamedRows& scans, const Columns& columns,
                   TileWriter& out) {
  scans.write_table(columns.scan_drive, columns.scan_number, out);
  for (std::size_t i = 0; i < tile.history.size(); ++i) {
    const TilePointHistory& each = tile.history[i];
    scans.write_row(columns.first, i, each.first, out);
    scans.write_row(columns.last, i, each.last, out);
    out.put(columns.normal, i, each.normal);
    out.put(columns.planarity, i, each.planarity);
  }
}

/// Bit i of a byte is cube 8 k + i.
std::array<std::uint8_t, kCubeBytes> bytes_of(const TileEvidence::Cubes& cubes) {
  std::array<std::uint8_t, kCubeBytes> bytes{};
  for (std::size_t cube = 0; cube < cubes.size(); ++cube)
    bytes.at(cube / 8) |= static_cast<std::uint8_t>((cubes[cube] ? 1U : 0U) << cube % 8);
  return bytes;
}

TileEvidence::Cubes cubes_of(const std::array<std::uint8_t, kCubeBytes>& bytes) {
  TileEvidence::Cubes cubes;
  for (std::size_t cube = 0; cube < cubes.size(); ++cube)
    cubes[cube] = (bytes.at(cube / 8) >> cube % 8 & 1U) != 0;
  return cubes;
}

void write_evidence(const TileEvidence& evidence, const Columns& columns, TileWriter& out) {
  if (!evidence.drives.empty()) out.put(columns.evidence_base, 0, evidence.base_m);
  for (std::size_t i = 0; i < evidence.drives.size(); ++i) {
    out.put(columns.evidence_drive, i, evidence.drives[i].drive);
    out.put(columns.free, i, bytes_of(evidence.drives[i].free));
    out.put(columns.hit, i, bytes_of(evidence.drives[i].hit));
  }
}

TileHead read_head(std::span<const std::byte> bytes, const std::string& name) {
  const auto refuse = [&](const std::string& found, const std::string& expected) {
    throw InputError(name, found, expected + ": copy or build the map again");
  };
  TileHead head;
  if (bytes.size() < sizeof(head)) refuse(fmt::format("{} bytes", bytes.size()), "a tile's head");
  std::memcpy(&head, bytes.data(), sizeof(head));
  if (head.points == 0) refuse("a tile without points", "at least one");
  constexpr std::uint32_t kKnownFlags = kHasHistory | kWideScanRows | kWideObjectRows;
  if ((head.flags & ~kKnownFlags) != 0)
    refuse(fmt::format("flags {}", head.flags), fmt::format("at most {}", kKnownFlags));
  const std::uint64_t expected = Columns(head).end;
  if (bytes.size() != expected)
    refuse(fmt::format("{} bytes for {} points", bytes.size(), head.points),
           fmt::format("{}", expected));
  return head;
}

/// Goes through a column of points. @throws InputError if one is not above the one before, or there
/// are no so many.
template <typename Take>
void for_each_listed(const TileReader& in, std::uint64_t column, std::uint32_t rows,
                     std::size_t points, const std::string& name, const Take& take) {
  std::int64_t before = -1;
  for (std::uint32_t row = 0; row < rows; ++row) {
    const auto index = in.at<std::uint32_t>(column, row);
    if (index >= points || index <= before)
      throw InputError(name, fmt::format("index {} after {} of {} points", index, before, points),
                       "ascending ones: copy or build the map again");
    before = index;
    take(row, index);
  }
}

/// Where a table of scans or objects lies, and whether the numbers of its rows have 32 bits.
struct NamedTable {
  std::uint64_t drives = 0, numbers = 0;
  std::uint32_t rows = 0;
  bool is_wide = false;
  const char* what = "";

  /// What the i-th number of a column names.
  [[nodiscard]] DriveNumber at(const TileReader& in, std::uint64_t column, std::size_t i,
                               const std::string& name) const {
    const std::uint32_t row =
        is_wide ? in.at<std::uint32_t>(column, i) : in.at<std::uint16_t>(column, i);
    if (row >= rows)
      throw InputError(name, fmt::format("{} {}", what, row),
                       fmt::format("below {}: copy or build the map again", rows));
    return {in.at<std::uint32_t>(drives, row), in.at<std::uint32_t>(numbers, row)};
  }
};

void read_points(const TileReader& in, const TileHead& head, const Columns& columns,
                 const std::string& name, TileContent& tile) {
  tile.z_base_m = head.z_base_m;
  tile.points.resize(head.points);
  for (std::size_t i = 0; i < head.points; ++i) {
    MapPoint& p = tile.points[i];
    p.x = middle_of(in.at<std::uint16_t>(columns.x, i));
    p.y = middle_of(in.at<std::uint16_t>(columns.y, i));
    p.z = height_of(in.at<std::uint16_t>(columns.z, i));
    p.intensity = static_cast<float>(in.at<Eigen::half>(columns.intensity, i));
    p.observations = in.at<std::uint16_t>(columns.observations, i);
    const auto kind = in.at<std::uint8_t>(columns.kind, i);
    if (kind > static_cast<std::uint8_t>(PointKind::kFilled))
      throw InputError(name, fmt::format("kind {} of point {}", kind, i),
                       "0 to 3: copy or build the map again");
    p.kind = static_cast<PointKind>(kind);
  }
  for_each_listed(in, columns.tall_index, head.tall, head.points, name,
                  [&](std::uint32_t row, std::uint32_t i) {
                    const auto step = in.at<std::int32_t>(columns.tall_steps, row);
                    if (std::abs(static_cast<double>(step)) > kMostTallSteps)
                      throw InputError(
                          name, fmt::format("{} steps of height", step),
                          fmt::format("at most {}: copy or build the map again", kMostTallSteps));
                    tile.points[i].z = height_of(step);
                  });
  const NamedTable objects{columns.object_drive, columns.object_number, head.objects,
                           (head.flags & kWideObjectRows) != 0, "object"};
  for_each_listed(in, columns.object_index, head.of_objects, head.points, name,
                  [&](std::uint32_t row, std::uint32_t i) {
                    tile.of_objects.push_back({i, objects.at(in, columns.object, row, name)});
                  });
}

void read_history(const TileReader& in, const TileHead& head, const Columns& columns,
                  const std::string& name, TileContent& tile) {
  const NamedTable scans{columns.scan_drive, columns.scan_number, head.scans,
                         (head.flags & kWideScanRows) != 0, "scan"};
  tile.history.resize(head.points);
  for (std::size_t i = 0; i < head.points; ++i) {
    TilePointHistory& each = tile.history[i];
    each.first = scans.at(in, columns.first, i, name);
    each.last = scans.at(in, columns.last, i, name);
    each.normal = in.at<std::array<std::int8_t, 3>>(columns.normal, i);
    each.planarity = in.at<std::uint8_t>(columns.planarity, i);
  }
}

TileEvidence read_evidence(const TileReader& in, const TileHead& head, const Columns& columns,
                           const std::string& name) {
  TileEvidence evidence;
  if (head.drives > 0) evidence.base_m = in.at<std::int32_t>(columns.evidence_base, 0);
  std::int64_t before = -1;
  for (std::uint32_t i = 0; i < head.drives; ++i) {
    using Bytes = std::array<std::uint8_t, kCubeBytes>;
    const auto drive = in.at<std::uint32_t>(columns.evidence_drive, i);
    if (drive <= before)
      throw InputError(name, fmt::format("evidence of drive {} after {}", drive, before),
                       "ascending ones: copy or build the map again");
    before = drive;
    evidence.drives.push_back(
        {drive, cubes_of(in.at<Bytes>(columns.free, i)), cubes_of(in.at<Bytes>(columns.hit, i))});
  }
  return evidence;
}

}  // namespace

TileEvidence decode_evidence(std::span<const std::byte> tile, const std::string& name) {
  const TileHead head = read_head(tile, name);
  return read_evidence(TileReader(tile), head, Columns(head), name);
}

bool has_history(std::span<const std::byte> tile, const std::string& name) {
  return (read_head(tile, name).flags & kHasHistory) != 0;
}

float in_tile_steps(double value_m) { return middle_of(tile_step_of(value_m)); }

float in_height_steps(double value_m) { return height_of(height_step_of(value_m)); }

float in_intensity_steps(float intensity) { return static_cast<float>(half_of(intensity)); }

Eigen::Vector3f in_steps(const Eigen::Vector3d& p_tile) {
  return {in_tile_steps(p_tile.x()), in_tile_steps(p_tile.y()), in_height_steps(p_tile.z())};
}

Eigen::Vector3f in_steps_of_voxel(const Eigen::Vector3d& p_tile, const Eigen::Vector3d& begin,
                                  double voxel_size_m) {
  const Eigen::Array3d steps(kTileStepM, kTileStepM, kTileStepZM);
  const Eigen::Array3d middle = in_steps(p_tile).cast<double>();
  const Eigen::Array3d below = (middle < begin.array()).cast<double>();
  const Eigen::Array3d above = (middle >= begin.array() + voxel_size_m).cast<double>();
  return in_steps(middle + steps * (below - above));
}

std::vector<std::byte> encode_tile(const TileContent& tile) {
  require_encodable(tile);
  const NamedRows scans = scans_of(tile), objects = objects_of(tile);
  TileHead head;
  head.points = static_cast<std::uint32_t>(tile.points.size());
  head.z_base_m = tile.z_base_m;
  head.of_objects = static_cast<std::uint32_t>(tile.of_objects.size());
  head.scans = scans.size();
  head.objects = objects.size();
  head.drives = static_cast<std::uint32_t>(tile.evidence.drives.size());
  if (!tile.history.empty()) head.flags |= kHasHistory;
  if (scans.is_wide()) head.flags |= kWideScanRows;
  if (objects.is_wide()) head.flags |= kWideObjectRows;
  for (const MapPoint& p : tile.points) head.tall += is_tall(height_step_of(p.z)) ? 1 : 0;
  const Columns columns(head);
  TileWriter out(columns.end);
  out.put(0, 0, head);
  write_points(tile, columns, out);
  write_objects(tile, objects, columns, out);
  write_history(tile, scans, columns, out);
  write_evidence(tile.evidence, columns, out);
  return out.take();
}

TileContent decode_tile(std::span<const std::byte> bytes, const std::string& name,
                        bool with_history) {
  const TileHead head = read_head(bytes, name);
  const Columns columns(head);
  const TileReader in(bytes);
  TileContent tile;
  read_points(in, head, columns, name, tile);
  if (!with_history) return tile;
  if ((head.flags & kHasHistory) != 0) read_history(in, head, columns, name, tile);
  tile.evidence = read_evidence(in, head, columns, name);
  return tile;
}

}  // namespace stillmap::maps
