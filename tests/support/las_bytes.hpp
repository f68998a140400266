#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::test {

/// A LAS file by hand, field by field as in the specification (LAS 1.4 R15), and apart from the
/// program's own writer.
struct LasBytes {
  struct Point {
    std::int32_t x = 0, y = 0, z = 0;
    std::uint16_t intensity = 0;
    std::uint8_t point_class = 2;
    bool withheld = false;
  };
  struct Record {
    std::string user;
    std::uint16_t id = 0;
    std::string content;
  };

  std::uint8_t minor = 2;
  std::uint8_t format = 0;
  /// Behind each point.
  std::uint16_t extra_bytes = 0;
  std::uint16_t encoding = 0;
  std::array<double, 3> scale{0.001, 0.001, 0.001}, offset{0, 0, 0};
  std::vector<Point> points;
  std::vector<Record> records;
  /// Behind the points (1.4).
  std::vector<Record> long_records;

  [[nodiscard]] static std::size_t point_bytes(int format) {
    return std::array<std::size_t, 11>{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67}.at(
        static_cast<std::size_t>(format));
  }

  [[nodiscard]] std::string bytes() const {
    const std::size_t header_bytes = minor == 4 ? 375 : minor == 3 ? 235 : 227;
    std::string head(header_bytes, '\0'), body, tail;
    for (const Record& record : records) body += record_bytes(record, false);
    const std::size_t first_point = header_bytes + body.size();
    for (const Point& point : points) body += point_record(point);
    for (const Record& record : long_records) tail += record_bytes(record, true);
    head.replace(0, 4, "LASF");
    put<std::uint16_t>(head, 6, encoding);
    head[24] = 1;
    head[25] = static_cast<char>(minor);
    put(head, 94, static_cast<std::uint16_t>(header_bytes));
    put(head, 96, static_cast<std::uint32_t>(first_point));
    put(head, 100, static_cast<std::uint32_t>(records.size()));
    head[104] = static_cast<char>(format);
    put(head, 105, static_cast<std::uint16_t>(point_bytes(format) + extra_bytes));
    if (minor < 4) put(head, 107, static_cast<std::uint32_t>(points.size()));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      put(head, 131 + 8 * axis, scale[axis]);
      put(head, 155 + 8 * axis, offset[axis]);
    }
    if (minor == 4) {
      put(head, 235, static_cast<std::uint64_t>(header_bytes + body.size()));
      put(head, 243, static_cast<std::uint32_t>(long_records.size()));
      put(head, 247, static_cast<std::uint64_t>(points.size()));
    }
    return head + body + tail;
  }

  /// Replaces a number in a file.
  template <typename Number>
  static void put(std::string& bytes, std::size_t place, Number number) {
    std::memcpy(&bytes.at(place), &number, sizeof number);
  }

 private:
  [[nodiscard]] static std::string record_bytes(const Record& record, bool is_long) {
    std::string bytes(is_long ? 60 : 54, '\0');
    bytes.replace(2, record.user.size(), record.user);
    put(bytes, 18, record.id);
    if (is_long)
      put(bytes, 20, static_cast<std::uint64_t>(record.content.size()));
    else
      put(bytes, 20, static_cast<std::uint16_t>(record.content.size()));
    return bytes + record.content;
  }

  [[nodiscard]] std::string point_record(const Point& point) const {
    std::string bytes(point_bytes(format), '\0');
    put(bytes, 0, point.x);
    put(bytes, 4, point.y);
    put(bytes, 8, point.z);
    put(bytes, 12, point.intensity);
    if (format < 6) {
      bytes[15] = static_cast<char>(point.point_class | (point.withheld ? 0x80 : 0));
    } else {
      bytes[15] = static_cast<char>(point.withheld ? 4 : 0);
      bytes[16] = static_cast<char>(point.point_class);
    }
    return bytes + std::string(extra_bytes, '\x7f');
  }
};

}  // namespace stillmap::test
