#include "formats/pcd_header.hpp"

#include <stillmap/maps/error.hpp>

#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

// More than any sensor writes; keeps the product of three counts far below 2^64.
constexpr std::size_t kMaxFields = 256;
constexpr std::uint64_t kMaxFieldCount = 65536;

using Fields = std::vector<std::string_view>;

/// What the lines of a header say, before they are put together.
struct HeaderLines {
  Fields names, sizes, types, counts;
  std::optional<std::uint64_t> width, height, points;
  std::optional<Eigen::Isometry3d> viewpoint;
};

char capital(char letter) {
  return static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
}

/// In capitals or small letters, as PCL reads them.
std::optional<NumberType> number_type(std::string_view type, std::string_view size) {
  if (type.size() != 1 || size.size() != 1) return std::nullopt;
  const std::string key{capital(type[0]), size[0]};
  constexpr std::array<std::string_view, 10> kKeys{"I1", "U1", "I2", "U2", "I4",
                                                   "U4", "I8", "U8", "F4", "F8"};
  for (std::size_t i = 0; i < kKeys.size(); ++i) {
    if (key == kKeys[i]) return static_cast<NumberType>(i);
  }
  return std::nullopt;
}

std::uint64_t parse_side(const Fields& line, const std::string& name) {
  const std::optional<std::uint64_t> value = line.size() == 2 ? parse_count(line[1]) : std::nullopt;
  if (!value || *value > kMostPcdPoints) {
    throw InputError(name, quoted(line[0]) + " without a usable number",
                     "one whole number up to 2^31");
  }
  return *value;
}

PcdEncoding parse_encoding(const Fields& line, const std::string& name) {
  const std::string_view text = line.size() == 2 ? line[1] : std::string_view();
  if (text == "ascii") return PcdEncoding::kAscii;
  if (text == "binary") return PcdEncoding::kBinary;
  if (text == "binary_compressed") return PcdEncoding::kBinaryCompressed;
  throw InputError(name, "DATA " + quoted(text),
                   "ascii, binary or binary_compressed: write the file as PCD 0.7");
}

/// tx ty tz qw qx qy qz, as PCL writes them.
std::optional<Eigen::Isometry3d> parse_viewpoint(const Fields& line) {
  constexpr double kMostOffNorm = 1e-3;
  std::array<double, 7> values{};
  if (line.size() != 1 + values.size()) return std::nullopt;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::optional<double> value = parse_number(line[i + 1]);
    if (!value || !std::isfinite(*value)) return std::nullopt;
    values[i] = *value;
  }
  const Eigen::Quaterniond q(values[3], values[4], values[5], values[6]);
  if (!(std::abs(q.norm() - 1.0) <= kMostOffNorm)) return std::nullopt;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << values[0], values[1], values[2];
  // An identity stays one to the bit.
  if (std::abs(q.w()) != 1.0) T.linear() = q.normalized().toRotationMatrix();
  return T;
}

/// Takes one line of the header. @return whether it is a line that a header may have.
bool take_header_line(const Fields& line, const std::string& name, HeaderLines& header) {
  const Fields values(line.begin() + 1, line.end());
  const std::string_view key = line[0];
  if (key == "VERSION") {
    const std::string_view version = values.size() == 1 ? values[0] : std::string_view();
    constexpr std::array<std::string_view, 6> kVersions{".5", "0.5", ".6", "0.6", ".7", "0.7"};
    for (const std::string_view known : kVersions) {
      if (version == known) return true;
    }
    throw InputError(name, "VERSION " + quoted(version),
                     "0.5, 0.6 or 0.7: write the file as PCD 0.7");
  }
  if (key == "FIELDS" || key == "COLUMNS") {
    header.names = values;
  } else if (key == "SIZE") {
    header.sizes = values;
  } else if (key == "TYPE") {
    header.types = values;
  } else if (key == "COUNT") {
    header.counts = values;
  } else if (key == "WIDTH") {
    header.width = parse_side(line, name);
  } else if (key == "HEIGHT") {
    header.height = parse_side(line, name);
  } else if (key == "POINTS") {
    header.points = parse_side(line, name);
  } else if (key == "VIEWPOINT") {
    // It is shown and not applied, so that a broken one does no harm.
    header.viewpoint = parse_viewpoint(line);
  } else {
    return false;
  }
  return true;
}

std::vector<PointField> assemble_fields(const HeaderLines& lines, const std::string& name) {
  const std::size_t count = lines.names.size();
  if (count > kMaxFields || lines.sizes.size() != count || lines.types.size() != count ||
      (!lines.counts.empty() && lines.counts.size() != count)) {
    throw InputError(name,
                     std::to_string(count) + " FIELDS, " + std::to_string(lines.sizes.size()) +
                         " SIZE, " + std::to_string(lines.types.size()) + " TYPE, " +
                         std::to_string(lines.counts.size()) + " COUNT",
                     "as many of each, at most " + std::to_string(kMaxFields));
  }
  std::vector<PointField> fields;
  for (std::size_t i = 0; i < count; ++i) {
    const std::optional<NumberType> type = number_type(lines.types[i], lines.sizes[i]);
    if (!type) {
      throw InputError(name, "TYPE " + quoted(lines.types[i]) + " SIZE " + quoted(lines.sizes[i]),
                       "I or U with 1 2 4 8, or F with 4 8");
    }
    const std::optional<std::uint64_t> numbers =
        lines.counts.empty() ? 1 : parse_count(lines.counts[i]);
    if (!numbers || *numbers > kMaxFieldCount) {
      throw InputError(name, "COUNT " + quoted(lines.counts[i]), "0 to 65536");
    }
    fields.push_back({std::string(lines.names[i]), *type, *numbers});
  }
  return fields;
}

std::size_t point_count(const HeaderLines& lines, const std::string& name, std::size_t max_points) {
  if (!lines.width && !lines.points)
    throw InputError(name, "no WIDTH and no POINTS", "one of them: write the file as PCD 0.7");
  const std::uint64_t grid =
      lines.width ? *lines.width * lines.height.value_or(1) : lines.points.value_or(0);
  if (lines.points && *lines.points != grid) {
    throw InputError(name, "POINTS " + std::to_string(*lines.points),
                     "WIDTH * HEIGHT = " + std::to_string(grid));
  }
  check_point_count(grid, max_points, name);
  return grid;
}

}  // namespace

PcdHeader parse_pcd_header(std::string_view text, const std::string& name, std::size_t max_points) {
  HeaderLines lines;
  PcdHeader header;
  std::string_view rest = text;
  while (const std::optional<std::string_view> line = take_line(rest)) {
    ++header.lines;
    const Fields fields = split_fields(*line);
    if (fields.empty() || fields[0].front() == '#') continue;
    if (fields[0] == "DATA") {
      // Without its newline the line may be cut short: "binary" of "binary_compressed".
      if (rest.empty() && text.back() != '\n') break;
      header.encoding = parse_encoding(fields, name);
      header.fields = assemble_fields(lines, name);
      header.points = point_count(lines, name, max_points);
      header.viewpoint = lines.viewpoint;
      header.body = text.size() - rest.size();
      return header;
    }
    if (!take_header_line(fields, name, lines)) {
      throw InputError(name, "header line " + quoted(*line),
                       "a line of a PCD header (VERSION, FIELDS, ...): write the file as PCD 0.7");
    }
  }
  throw InputError(name, "a header without its DATA line",
                   "a whole PCD header: copy or write the file again");
}

}  // namespace stillmap::maps
