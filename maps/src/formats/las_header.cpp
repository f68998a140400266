#include "formats/las_header.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <string_view>

namespace stillmap::maps {
namespace {

/// Sizes of a header by its minor version, and of a point by its format (LAS 1.4 R15).
constexpr std::array<std::size_t, 5> kHeaderBytes{227, 227, 227, 235, 375};
constexpr std::array<std::size_t, 11> kPointBytes{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
constexpr std::size_t kRecordHeaderBytes = 54;
constexpr std::size_t kLongRecordHeaderBytes = 60;
/// A laz file has one of these added to its point format.
constexpr unsigned kCompressed = 0xC0;
constexpr int kWktRecord = 2112;
constexpr int kGeoKeysRecord = 34735;

/// Little-endian numbers at places that the caller has checked.
class Bytes {
 public:
  explicit Bytes(std::span<const std::byte> bytes) : bytes_(bytes) {}
  template <typename Number>
  [[nodiscard]] Number at(std::size_t place) const {
    Number number;
    std::memcpy(&number, &bytes_[place], sizeof number);
    return number;
  }
  /// Up to a zero, at most `most` bytes.
  [[nodiscard]] std::string_view text(std::size_t place, std::size_t most) const {
    const std::string_view field(reinterpret_cast<const char*>(&bytes_[place]), most);
    return field.substr(0, std::min(field.find('\0'), field.size()));
  }

 private:
  std::span<const std::byte> bytes_;
};

[[noreturn]] void refuse_compressed(const std::string& name, const char* what) {
  throw InputError(name, what,
                   "LAS, uncompressed: `pdal translate IN.laz OUT.las`, or `laszip -i IN.laz -o "
                   "OUT.las`");
}

/// What the records before and behind the points say of the coordinates.
class Records {
 public:
  Records(std::span<const std::byte> bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  void take_short(std::size_t place, std::uint32_t count, std::size_t end) {
    const Bytes at(bytes_);
    for (std::uint32_t i = 0; i < count; ++i) {
      require(place, kRecordHeaderBytes, end);
      const std::size_t size = at.at<std::uint16_t>(place + 20);
      require(place + kRecordHeaderBytes, size, end);
      take(at.text(place + 2, 16), at.at<std::uint16_t>(place + 18),
           bytes_.subspan(place + kRecordHeaderBytes, size));
      place += kRecordHeaderBytes + size;
    }
  }

  void take_long(std::uint64_t place, std::uint32_t count) {
    const Bytes at(bytes_);
    for (std::uint32_t i = 0; i < count; ++i) {
      require(place, kLongRecordHeaderBytes, bytes_.size());
      const auto size = at.at<std::uint64_t>(place + 20);
      require(place + kLongRecordHeaderBytes, size, bytes_.size());
      take(at.text(place + 2, 16), at.at<std::uint16_t>(place + 18),
           bytes_.subspan(place + kLongRecordHeaderBytes, size));
      place += kLongRecordHeaderBytes + size;
    }
  }

  [[nodiscard]] CoordinateSystem system(bool prefers_wkt) const {
    if (wkt_ && (prefers_wkt || !geo_keys_)) return *wkt_;
    return geo_keys_.value_or(CoordinateSystem{});
  }

 private:
  void require(std::uint64_t place, std::uint64_t size, std::size_t end) const {
    if (place > end || size > end - place)
      throw InputError(
          name_, "a record of " + std::to_string(size) + " bytes at " + std::to_string(place),
          "one that ends within " + std::to_string(end) + " bytes: copy the file again");
  }

  void take(std::string_view user, int id, std::span<const std::byte> content) {
    if (user == "laszip encoded") refuse_compressed(name_, "LAZ, compressed points");
    if (user == "copc") refuse_compressed(name_, "COPC, compressed points");
    if (user != "LASF_Projection") return;
    if (id == kWktRecord)
      wkt_ = read_wkt({reinterpret_cast<const char*>(content.data()), content.size()});
    if (id == kGeoKeysRecord) geo_keys_ = read_geo_keys(content);
  }

  std::span<const std::byte> bytes_;
  const std::string& name_;
  std::optional<CoordinateSystem> wkt_, geo_keys_;
};

void read_version(const Bytes& at, std::size_t size, const std::string& name, LasHeader& header) {
  const int major = at.at<std::uint8_t>(24);
  header.minor_version = at.at<std::uint8_t>(25);
  if (major != 1 || header.minor_version > 4)
    throw InputError(name,
                     "LAS " + std::to_string(major) + "." + std::to_string(header.minor_version),
                     "1.0 to 1.4: export it again in one of these versions");
  const std::size_t needed = kHeaderBytes.at(static_cast<std::size_t>(header.minor_version));
  const std::size_t stated = at.at<std::uint16_t>(94);
  if (stated < needed || size < stated)
    throw InputError(name,
                     std::to_string(size) + " bytes with a header of " + std::to_string(stated),
                     "a header of at least " + std::to_string(needed) + ": copy the file again");
}

void read_point_layout(const Bytes& at, const std::string& name, LasHeader& header) {
  const unsigned format = at.at<std::uint8_t>(104);
  if ((format & kCompressed) != 0) refuse_compressed(name, "LAZ, compressed points");
  header.point_format = static_cast<int>(format);
  if (format >= kPointBytes.size())
    throw InputError(name, "point format " + std::to_string(format),
                     "0 to 10: export the file as LAS 1.4");
  header.point_bytes = at.at<std::uint16_t>(105);
  if (header.point_bytes < kPointBytes[format])
    throw InputError(name, "points of " + std::to_string(header.point_bytes) + " bytes",
                     "at least " + std::to_string(kPointBytes[format]) + " in point format " +
                         std::to_string(format));
}

void find_points(const Bytes& at, std::size_t size, const std::string& name, LasHeader& header) {
  header.first_point = at.at<std::uint32_t>(96);
  if (header.first_point < at.at<std::uint16_t>(94) || header.first_point > size)
    throw InputError(name, "points from byte " + std::to_string(header.first_point) + " on",
                     "within " + std::to_string(size) + " bytes and behind the header");
  header.points = at.at<std::uint32_t>(107);
  if (header.minor_version == 4 && at.at<std::uint64_t>(247) != 0)
    header.points = at.at<std::uint64_t>(247);
  // Records may follow the points of 1.4.
  const bool has_long_records = header.minor_version == 4 && at.at<std::uint32_t>(243) > 0;
  const std::uint64_t end = has_long_records ? at.at<std::uint64_t>(235) : size;
  if (header.points == 0 && end >= header.first_point + header.point_bytes)
    throw InputError(
        name,
        "a count of 0 points and " + std::to_string(end - header.first_point) + " bytes of them",
        "the count: its writer was killed; `lasinfo -repair` counts the points");
  if (header.points > (size - header.first_point) / header.point_bytes)
    throw InputError(name, std::to_string(size - header.first_point) + " bytes of points",
                     std::to_string(header.points) + " points of " +
                         std::to_string(header.point_bytes) + " bytes: copy the file again");
}

void read_scale(const Bytes& at, const std::string& name, LasHeader& header) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    header.scale[axis] = at.at<double>(131 + 8 * axis);
    header.offset[axis] = at.at<double>(155 + 8 * axis);
    if (!(std::abs(header.scale[axis]) > 0.0 && std::abs(header.scale[axis]) <= 1e6) ||
        !(std::abs(header.offset[axis]) <= 1e12))
      throw InputError(name,
                       "scale " + std::to_string(header.scale[axis]) + ", offset " +
                           std::to_string(header.offset[axis]),
                       "a scale of up to 1e6 other than 0 and an offset of up to 1e12");
  }
}

}  // namespace

LasHeader read_las_start(std::span<const std::byte> bytes, const std::string& name) {
  const Bytes at(bytes);
  if (bytes.size() < kHeaderBytes[2] || at.text(0, 4) != "LASF")
    throw InputError(name, std::to_string(bytes.size()) + " bytes without a LAS header",
                     "a LAS file, which begins with LASF: export the points as LAS 1.4");
  LasHeader header;
  read_version(at, bytes.size(), name, header);
  read_point_layout(at, name, header);
  read_scale(at, name, header);
  return header;
}

LasHeader read_las_header(std::span<const std::byte> bytes, const std::string& name) {
  LasHeader header = read_las_start(bytes, name);
  const Bytes at(bytes);
  find_points(at, bytes.size(), name, header);
  Records records(bytes, name);
  records.take_short(at.at<std::uint16_t>(94), at.at<std::uint32_t>(100), header.first_point);
  if (header.minor_version == 4)
    records.take_long(at.at<std::uint64_t>(235), at.at<std::uint32_t>(243));
  constexpr unsigned kWktBit = 1U << 4U;
  // Reserved before LAS 1.2, and not always zero.
  const unsigned encoding = header.minor_version < 2 ? 0 : at.at<std::uint16_t>(6);
  header.system = records.system((encoding & kWktBit) != 0);
  return header;
}

}  // namespace stillmap::maps
