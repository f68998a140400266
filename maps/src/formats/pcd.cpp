#include "formats/pcd.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <optional>

#include "formats/cloud_stream.hpp"
#include "formats/lzf.hpp"
#include "formats/point_table.hpp"
#include "formats/text.hpp"

namespace stillmap::maps {
namespace {

// More than any sensor writes; keeps the product of three counts far below 2^64.
constexpr std::size_t kMaxFields = 256;
constexpr std::uint64_t kMaxFieldCount = 65536;
constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 31U;

enum class Encoding { kAscii, kBinary, kBinaryCompressed };

struct Header {
  std::vector<PointField> fields;
  std::size_t points = 0;
  Encoding encoding = Encoding::kAscii;
  /// Of the first byte behind the header.
  std::size_t body = 0;
  std::size_t lines = 0;

  /// Bytes of one point.
  [[nodiscard]] std::size_t stride(bool with_padding) const {
    std::size_t bytes = 0;
    for (const PointField& field : fields) {
      if (with_padding || field.name != "_") bytes += field.count * size_of(field.type);
    }
    return bytes;
  }
};

using Fields = std::vector<std::string_view>;

/// What the lines of a header say, before they are put together.
struct HeaderLines {
  Fields names, sizes, types, counts;
  std::optional<std::uint64_t> width, height, points;
};

std::optional<NumberType> number_type(std::string_view type, std::string_view size) {
  if (type.size() != 1 || size.size() != 1) return std::nullopt;
  const std::string key{type[0], size[0]};
  constexpr std::array<std::string_view, 10> kKeys{"I1", "U1", "I2", "U2", "I4",
                                                   "U4", "I8", "U8", "F4", "F8"};
  for (std::size_t i = 0; i < kKeys.size(); ++i) {
    if (key == kKeys[i]) return static_cast<NumberType>(i);
  }
  return std::nullopt;
}

std::string quoted(std::string_view text) { return "'" + std::string(text.substr(0, 64)) + "'"; }

std::uint64_t parse_side(const Fields& line, const std::string& name) {
  const std::optional<std::uint64_t> value = line.size() == 2 ? parse_count(line[1]) : std::nullopt;
  if (!value || *value > kMaxSide) {
    throw InputError(name, quoted(line[0]) + " without a usable number",
                     "one whole number up to 2^31");
  }
  return *value;
}

Encoding parse_encoding(const Fields& line, const std::string& name) {
  const std::string_view text = line.size() == 2 ? line[1] : std::string_view();
  if (text == "ascii") return Encoding::kAscii;
  if (text == "binary") return Encoding::kBinary;
  if (text == "binary_compressed") return Encoding::kBinaryCompressed;
  throw InputError(name, "DATA " + quoted(text), "ascii, binary or binary_compressed");
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
    throw InputError(name, "VERSION " + quoted(version), "0.5, 0.6 or 0.7");
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
  } else {
    return key == "VIEWPOINT";
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
    throw InputError(name, "no WIDTH and no POINTS", "one of them");
  const std::uint64_t grid =
      lines.width ? *lines.width * lines.height.value_or(1) : lines.points.value_or(0);
  if (lines.points && *lines.points != grid) {
    throw InputError(name, "POINTS " + std::to_string(*lines.points),
                     "WIDTH * HEIGHT = " + std::to_string(grid));
  }
  check_point_count(grid, max_points, name);
  return grid;
}

Header parse_header(std::string_view text, const std::string& name, std::size_t max_points) {
  HeaderLines lines;
  Header header;
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
      header.body = text.size() - rest.size();
      return header;
    }
    if (!take_header_line(fields, name, lines)) {
      throw InputError(name, "header line " + quoted(*line), "a PCD header (VERSION, FIELDS, ...)");
    }
  }
  throw InputError(name, "a header without its DATA line", "a whole PCD header");
}

void check_body(std::size_t found, std::size_t needed, const Header& header,
                const std::string& name) {
  if (found < needed) {
    throw InputError(
        name, std::to_string(found) + " bytes of points",
        "at least " + std::to_string(needed) + " for " + std::to_string(header.points) + " points");
  }
}

/// @param make  of the table, or of what else takes the points: called once these bytes are known
/// to hold so many of them. @return what it made, filled.
template <typename Make>
auto read_ascii(std::string_view body, const Header& header, const std::vector<Role>& roles,
                const std::string& name, const Make& make) {
  std::size_t numbers = 0;
  for (const PointField& field : header.fields) numbers += field.count;
  // Each number takes a digit and a blank, the last of all no blank.
  check_body(body.size() + 1, header.points * numbers * 2, header, name);
  auto table = make();
  std::size_t line_number = header.lines;
  for (std::size_t point = 0; point < header.points;) {
    const std::optional<std::string_view> line = take_line(body);
    if (!line) {
      throw InputError(name, std::to_string(point) + " lines of points",
                       std::to_string(header.points));
    }
    ++line_number;
    const Fields texts = split_fields(*line, numbers + 1);
    if (texts.empty()) continue;
    if (texts.size() != numbers) {
      throw InputError(
          place(name, line_number),
          texts.size() > numbers ? "more numbers" : std::to_string(texts.size()) + " numbers",
          std::to_string(numbers));
    }
    std::size_t next = 0;
    for (std::size_t f = 0; f < roles.size(); next += header.fields[f].count, ++f) {
      if (roles[f] == Role::kNone) continue;
      const std::optional<double> value = parse_number(texts[next]);
      if (!value) throw InputError(place(name, line_number), quoted(texts[next]), "a number");
      table.set(roles[f], point, *value);
    }
    ++point;
    if (point % kRowsAtOnce == 0 || point == header.points) table.reached(point);
  }
  return table;
}

template <typename Make>
auto read_binary(std::span<const std::byte> body, const Header& header,
                 const std::vector<Role>& roles, const std::string& name, const Make& make) {
  const std::size_t stride = header.stride(true);
  check_body(body.size(), header.points * stride, header, name);
  auto table = make();
  for (std::size_t begin = 0; begin < header.points; begin += kRowsAtOnce) {
    const std::size_t end = std::min(header.points, begin + kRowsAtOnce);
    std::size_t offset = 0;
    for (std::size_t f = 0; f < roles.size(); ++f) {
      const PointField& field = header.fields[f];
      if (roles[f] != Role::kNone) {
        for (std::size_t i = begin; i < end; ++i)
          table.set(roles[f], i, read_number(&body[i * stride + offset], field.type));
      }
      offset += field.count * size_of(field.type);
    }
    table.reached(end);
  }
  return table;
}

/// Takes the unpacked bytes of `binary_compressed`, which come column by column, in pieces of any
/// length.
template <typename Table>
class ColumnReader {
 public:
  ColumnReader(const Header& header, const std::vector<Role>& roles, bool with_padding,
               Table& table)
      : header_(header), roles_(roles), with_padding_(with_padding), table_(table) {}

  void take(std::span<const std::byte> piece) {
    while (!piece.empty() && column_ < roles_.size()) {
      piece = roles_[column_] == Role::kNone ? skip(piece) : read(piece);
    }
  }

 private:
  [[nodiscard]] std::size_t column_bytes() const {
    const PointField& field = header_.fields[column_];
    if (!with_padding_ && field.name == "_") return 0;
    return field.count * size_of(field.type) * header_.points;
  }
  void next_column() {
    ++column_;
    done_bytes_ = 0;
  }
  std::span<const std::byte> skip(std::span<const std::byte> piece) {
    const std::size_t count = std::min(piece.size(), column_bytes() - done_bytes_);
    done_bytes_ += count;
    if (done_bytes_ == column_bytes()) next_column();
    return piece.subspan(count);
  }
  /// One number, or the part of it that this piece still holds.
  std::span<const std::byte> read(std::span<const std::byte> piece) {
    const NumberType type = header_.fields[column_].type;
    const std::size_t size = size_of(type);
    const std::size_t have = done_bytes_ % size;
    const std::size_t count = std::min(size - have, piece.size());
    std::memcpy(&number_[have], piece.data(), count);
    done_bytes_ += count;
    if (have + count == size) {
      table_.set(roles_[column_], done_bytes_ / size - 1, read_number(number_.data(), type));
      if (done_bytes_ == column_bytes()) next_column();
    }
    return piece.subspan(count);
  }

  const Header& header_;
  const std::vector<Role>& roles_;
  bool with_padding_;
  Table& table_;
  std::size_t column_ = 0;
  std::size_t done_bytes_ = 0;
  std::array<std::byte, 8> number_{};
};

template <typename Make>
auto read_compressed(std::span<const std::byte> body, const Header& header,
                     const std::vector<Role>& roles, const std::string& name, const Make& make) {
  std::array<std::uint32_t, 2> sizes{};
  check_body(body.size(), sizeof(sizes), header, name);
  std::memcpy(sizes.data(), body.data(), sizeof(sizes));
  const auto [packed, unpacked] = sizes;
  body = body.subspan(sizeof(sizes));
  check_body(body.size(), packed, header, name);
  // PCL leaves padding out of the packed columns; others keep it.
  const bool with_padding = unpacked != header.points * header.stride(false);
  if (with_padding && unpacked != header.points * header.stride(true)) {
    throw InputError(name, std::to_string(unpacked) + " unpacked bytes",
                     std::to_string(header.points * header.stride(true)) + " for " +
                         std::to_string(header.points) + " points");
  }
  // Before anything is allocated for points that these bytes cannot hold.
  if (unpacked > max_lzf_output(packed)) {
    throw InputError(name, std::to_string(packed) + " packed bytes",
                     "enough for " + std::to_string(unpacked) + " unpacked ones");
  }
  auto table = make();
  ColumnReader columns(header, roles, with_padding, table);
  unpack_lzf(body.first(packed), unpacked, name,
             [&](std::span<const std::byte> piece) { columns.take(piece); });
  table.reached(header.points);
  return table;
}

template <typename Make>
auto read_points(std::span<const std::byte> bytes, const Header& header,
                 const std::vector<Role>& roles, const std::string& name, const Make& make) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  switch (header.encoding) {
    case Encoding::kAscii:
      return read_ascii(text.substr(header.body), header, roles, name, make);
    case Encoding::kBinary:
      return read_binary(bytes.subspan(header.body), header, roles, name, make);
    case Encoding::kBinaryCompressed:
      return read_compressed(bytes.subspan(header.body), header, roles, name, make);
  }
  throw std::logic_error("unknown PCD encoding");
}

std::string_view header_part(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()),
          std::min(bytes.size(), kMostCloudHeaderBytes)};
}

}  // namespace

DecodedScan decode_pcd(std::span<const std::byte> bytes, const std::string& name,
                       std::size_t max_points) {
  const Header header = parse_header(header_part(bytes), name, max_points);
  const std::vector<Role> roles = roles_of(header.fields, name);
  return read_points(bytes, header, roles, name,
                     [&] { return PointTable(header.fields, roles, header.points); })
      .finish();
}

CloudSummary stream_pcd(std::span<const std::byte> bytes, const std::string& name,
                        const CloudStream::Take& take) {
  const Header header = parse_header(header_part(bytes), name, kMaxSide);
  const std::vector<Role> roles = roles_of(header.fields, name);
  std::size_t held = std::min(header.points, kRowsAtOnce);
  if (header.encoding == Encoding::kBinaryCompressed) {
    check_point_count(header.points, kMostCompressedPoints, name);
    held = header.points;
  }
  CloudSummary summary = read_points(bytes, header, roles, name, [&] {
                           return CloudStream(header.fields, roles, held, take);
                         }).summary();
  // Text has as many digits as it was written with.
  if (header.encoding == Encoding::kAscii) summary.single_precision = false;
  return summary;
}

void check_pcd_header(std::span<const std::byte> head, const std::string& name) {
  const Header header = parse_header(header_part(head), name, kMaxSide);
  (void)roles_of(header.fields, name);
}

}  // namespace stillmap::maps
