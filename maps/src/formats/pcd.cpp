#include "formats/pcd.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <stillmap/maps/text.hpp>
#include "formats/cloud_stream.hpp"
#include "formats/file_reader.hpp"
#include "formats/lzf.hpp"
#include "formats/pcd_header.hpp"
#include "formats/point_table.hpp"

namespace stillmap::maps {
namespace {

void check_body(std::size_t found, std::size_t needed, const PcdHeader& header,
                const std::string& name) {
  if (found < needed) {
    throw InputError(name, std::to_string(found) + " bytes of points",
                     "at least " + std::to_string(needed) + " for the " +
                         std::to_string(header.points) +
                         " points of its header: copy or write the file again");
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
      throw InputError(
          name, std::to_string(point) + " lines of points",
          std::to_string(header.points) + ", as its header says: copy or write the file again");
    }
    ++line_number;
    const std::vector<std::string_view> texts = split_fields(*line, numbers + 1);
    if (texts.empty()) continue;
    if (texts.size() != numbers) {
      throw InputError(
          place(name, line_number),
          texts.size() > numbers ? "more numbers" : std::to_string(texts.size()) + " numbers",
          std::to_string(numbers) + ", as FIELDS and COUNT say");
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

/// Numbers of one column of `binary_compressed`, in which column lies after column.
template <typename Table>
void read_column(LzfReader& reader, NumberType type, Role role, std::size_t begin, std::size_t end,
                 Table& table) {
  const std::size_t size = size_of(type);
  std::vector<std::byte> bytes(std::min(end - begin, kRowsAtOnce) * size);
  for (std::size_t at = begin; at < end; at += kRowsAtOnce) {
    const std::size_t count = std::min(end - at, kRowsAtOnce);
    reader.read(std::span(bytes).first(count * size));
    for (std::size_t i = 0; i < count; ++i)
      table.set(role, at + i, read_number(&bytes[i * size], type));
  }
}

/// Bytes that a point has in each packed column.
std::vector<std::size_t> column_bytes(const PcdHeader& header, bool with_padding) {
  std::vector<std::size_t> bytes;
  for (const PointField& field : header.fields)
    bytes.push_back(!with_padding && field.name == "_" ? 0 : field.count * size_of(field.type));
  return bytes;
}

/// Column after column, into a table that holds all points.
void fill(PointTable& table, LzfReader reader, const PcdHeader& header,
          const std::vector<Role>& roles, const std::vector<std::size_t>& bytes) {
  for (std::size_t f = 0; f < roles.size(); ++f) {
    if (roles[f] == Role::kNone)
      reader.skip(bytes[f] * header.points);
    else
      read_column(reader, header.fields[f].type, roles[f], 0, header.points, table);
  }
  reader.finish();
}

/// Row after row, with a reader in each column: unpacking up to four times costs time, all points
/// at once would cost memory.
void fill(CloudStream& stream, LzfReader reader, const PcdHeader& header,
          const std::vector<Role>& roles, const std::vector<std::size_t>& bytes) {
  std::vector<std::pair<std::size_t, LzfReader>> columns;
  for (std::size_t f = 0; f < roles.size(); ++f) {
    if (CloudStream::takes(roles[f])) columns.emplace_back(f, reader);
    reader.skip(bytes[f] * header.points);
  }
  reader.finish();
  for (std::size_t begin = 0; begin < header.points; begin += kRowsAtOnce) {
    const std::size_t end = std::min(header.points, begin + kRowsAtOnce);
    for (auto& [f, column] : columns)
      read_column(column, header.fields[f].type, roles[f], begin, end, stream);
    stream.reached(end);
  }
}

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
                         std::to_string(header.points) + " points: write the file again");
  }
  // Before anything is allocated for points that these bytes cannot hold.
  if (unpacked > max_lzf_output(packed)) {
    throw InputError(
        name, std::to_string(packed) + " packed bytes",
        "enough for " + std::to_string(unpacked) + " unpacked ones: copy or write the file again");
  }
  auto table = make();
  fill(table, LzfReader(body.first(packed), unpacked, name), header, roles,
       column_bytes(header, with_padding));
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

}  // namespace

DecodedScan decode_pcd(std::span<const std::byte> bytes, const std::string& name,
                       std::size_t max_points, std::optional<std::int64_t> stamp_ns) {
  const PcdHeader header = parse_pcd_header(header_part(bytes), name, max_points);
  const std::vector<Role> roles = roles_of(header.fields, name);
  return read_points(bytes, header, roles, name,
                     [&] { return PointTable(header.fields, roles, header.points, stamp_ns); })
      .finish();
}

CloudSummary stream_pcd(std::span<const std::byte> bytes, const std::string& name,
                        const CloudStream::Take& take) {
  const PcdHeader header = parse_pcd_header(header_part(bytes), name, kMostPcdPoints);
  const std::vector<Role> roles = roles_of(header.fields, name);
  const std::size_t held = std::min(header.points, kRowsAtOnce);
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
