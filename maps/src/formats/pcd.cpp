#include "formats/pcd.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <stdexcept>

#include "formats/cloud_stream.hpp"
#include "formats/file_reader.hpp"
#include "formats/lzf.hpp"
#include "formats/pcd_header.hpp"
#include "formats/point_table.hpp"
#include "formats/text.hpp"

namespace stillmap::maps {
namespace {

void check_body(std::size_t found, std::size_t needed, const PcdHeader& header,
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
auto read_ascii(std::string_view body, const PcdHeader& header, const std::vector<Role>& roles,
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
    const std::vector<std::string_view> texts = split_fields(*line, numbers + 1);
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
      if (!value)
        throw InputError(place(name, line_number),
                         "'" + std::string(texts[next].substr(0, 64)) + "'", "a number");
      table.set(roles[f], point, *value);
    }
    ++point;
    if (point % kRowsAtOnce == 0 || point == header.points) table.reached(point);
  }
  return table;
}

template <typename Make>
auto read_binary(std::span<const std::byte> body, const PcdHeader& header,
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
  ColumnReader(const PcdHeader& header, const std::vector<Role>& roles, bool with_padding,
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

  const PcdHeader& header_;
  const std::vector<Role>& roles_;
  bool with_padding_;
  Table& table_;
  std::size_t column_ = 0;
  std::size_t done_bytes_ = 0;
  std::array<std::byte, 8> number_{};
};

template <typename Make>
auto read_compressed(std::span<const std::byte> body, const PcdHeader& header,
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
auto read_points(std::span<const std::byte> bytes, const PcdHeader& header,
                 const std::vector<Role>& roles, const std::string& name, const Make& make) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  switch (header.encoding) {
    case PcdEncoding::kAscii:
      return read_ascii(text.substr(header.body), header, roles, name, make);
    case PcdEncoding::kBinary:
      return read_binary(bytes.subspan(header.body), header, roles, name, make);
    case PcdEncoding::kBinaryCompressed:
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
  const PcdHeader header = parse_pcd_header(header_part(bytes), name, max_points);
  const std::vector<Role> roles = roles_of(header.fields, name);
  return read_points(bytes, header, roles, name,
                     [&] { return PointTable(header.fields, roles, header.points); })
      .finish();
}

CloudSummary stream_pcd(std::span<const std::byte> bytes, const std::string& name,
                        const CloudStream::Take& take) {
  const PcdHeader header = parse_pcd_header(header_part(bytes), name, kMostPcdPoints);
  const std::vector<Role> roles = roles_of(header.fields, name);
  std::size_t held = std::min(header.points, kRowsAtOnce);
  if (header.encoding == PcdEncoding::kBinaryCompressed) {
    check_point_count(header.points, kMostCompressedPoints, name);
    held = header.points;
  }
  CloudSummary summary = read_points(bytes, header, roles, name, [&] {
                           return CloudStream(header.fields, roles, held, take);
                         }).summary();
  summary.viewpoint = header.viewpoint;
  // Text has as many digits as it was written with.
  if (header.encoding == PcdEncoding::kAscii) summary.single_precision = false;
  return summary;
}

std::optional<Eigen::Isometry3d> read_pcd_viewpoint(const std::filesystem::path& file) {
  const FileReader reader(file);
  std::vector<std::byte> head(std::min<std::uint64_t>(reader.size(), kMostCloudHeaderBytes));
  head.resize(reader.read_at(0, head));
  try {
    return parse_pcd_header(header_part(head), file.string(), kMostPcdPoints).viewpoint;
  } catch (const InputError&) {
    return std::nullopt;
  }
}

void check_pcd_header(std::span<const std::byte> head, const std::string& name) {
  const PcdHeader header = parse_pcd_header(header_part(head), name, kMostPcdPoints);
  (void)roles_of(header.fields, name);
}

}  // namespace stillmap::maps
