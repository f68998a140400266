#include "formats/ply.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include <stillmap/maps/text.hpp>
#include "formats/cloud_stream.hpp"
#include "formats/point_table.hpp"

namespace stillmap::maps {
namespace {

using Fields = std::vector<std::string_view>;

struct Property {
  PointField field;
  /// Set for lists: type of the number that says how many follow.
  std::optional<NumberType> length_type;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

enum class PlyEncoding { kAscii, kLittleEndian, kBigEndian };

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::kAscii;
  std::vector<Element> elements;
  std::size_t body = 0;
};

NumberType ply_type(std::string_view text, const std::string& name) {
  struct Name {
    std::string_view text;
    NumberType type;
  };
  constexpr std::array<Name, 16> kNames{{{"char", NumberType::kI8},
                                         {"int8", NumberType::kI8},
                                         {"uchar", NumberType::kU8},
                                         {"uint8", NumberType::kU8},
                                         {"short", NumberType::kI16},
                                         {"int16", NumberType::kI16},
                                         {"ushort", NumberType::kU16},
                                         {"uint16", NumberType::kU16},
                                         {"int", NumberType::kI32},
                                         {"int32", NumberType::kI32},
                                         {"uint", NumberType::kU32},
                                         {"uint32", NumberType::kU32},
                                         {"float", NumberType::kF32},
                                         {"float32", NumberType::kF32},
                                         {"double", NumberType::kF64},
                                         {"float64", NumberType::kF64}}};
  for (const Name& known : kNames) {
    if (text == known.text) return known.type;
  }
  throw InputError(name, "property type " + quoted(text), "a PLY number type");
}

PlyEncoding parse_ply_encoding(const Fields& line, const std::string& name) {
  if (line.size() == 3 && line[2] == "1.0") {
    if (line[1] == "ascii") return PlyEncoding::kAscii;
    if (line[1] == "binary_little_endian") return PlyEncoding::kLittleEndian;
    if (line[1] == "binary_big_endian") return PlyEncoding::kBigEndian;
  }
  throw InputError(
      name, "format " + quoted(line.size() > 1 ? line[1] : std::string_view()),
      "ascii, binary_little_endian or binary_big_endian 1.0: write the file in one of these");
}

Element parse_element(const Fields& line, const std::string& name) {
  const std::optional<std::uint64_t> count = line.size() == 3 ? parse_count(line[2]) : std::nullopt;
  if (!count) throw InputError(name, "an element line without its count", "element NAME COUNT");
  return {std::string(line[1]), *count, {}};
}

Property parse_property(const Fields& line, const std::string& name) {
  Property property;
  if (line.size() == 5 && line[1] == "list") {
    property.length_type = ply_type(line[2], name);
    property.field = {std::string(line[4]), ply_type(line[3], name), 0};
    if (!is_whole(*property.length_type)) {
      throw InputError(name, "list length of type " + quoted(line[2]), "a whole number type");
    }
  } else if (line.size() == 3) {
    property.field = {std::string(line[2]), ply_type(line[1], name), 1};
  } else {
    throw InputError(name, "a property line of " + std::to_string(line.size()) + " words",
                     "property TYPE NAME, or property list TYPE TYPE NAME");
  }
  return property;
}

PlyHeader parse_ply_header(std::string_view text, const std::string& name) {
  std::string_view rest = text;
  const Fields magic = split_fields(take_line(rest).value_or(""), 2);
  if (magic.size() != 1 || magic[0] != "ply") {
    throw InputError(name, "a first line that is not 'ply'",
                     "a PLY file: export the points as PLY 1.0");
  }
  PlyHeader header;
  bool with_encoding = false;
  while (const std::optional<std::string_view> line = take_line(rest)) {
    const Fields fields = split_fields(*line);
    if (fields.empty() || fields[0] == "comment" || fields[0] == "obj_info") continue;
    if (fields[0] == "format") {
      header.encoding = parse_ply_encoding(fields, name);
      with_encoding = true;
    } else if (fields[0] == "element") {
      header.elements.push_back(parse_element(fields, name));
    } else if (fields[0] == "property" && !header.elements.empty()) {
      header.elements.back().properties.push_back(parse_property(fields, name));
    } else if (fields[0] == "end_header" && with_encoding &&
               (!rest.empty() || text.back() == '\n')) {
      header.body = text.size() - rest.size();
      return header;
    } else {
      throw InputError(name, "header line " + quoted(*line), "a PLY header line in its place");
    }
  }
  throw InputError(name, "a header without its end_header line",
                   "a whole PLY header: copy or write the file again");
}

/// Numbers of the body one after the other, in either encoding.
class NumberStream {
 public:
  NumberStream(std::span<const std::byte> body, PlyEncoding encoding, const std::string& name)
      : body_(body), encoding_(encoding), name_(name) {}

  [[nodiscard]] std::size_t bytes_left() const { return body_.size(); }
  /// Fewest bytes that a number takes: in text a digit and a blank.
  [[nodiscard]] std::size_t min_bytes(NumberType type) const {
    return encoding_ == PlyEncoding::kAscii ? 2 : size_of(type);
  }

  double next(NumberType type) {
    if (encoding_ == PlyEncoding::kAscii) return next_text();
    const double value =
        read_number(cut(size_of(type)).data(), type, encoding_ == PlyEncoding::kBigEndian);
    return value;
  }
  void skip(NumberType type, std::uint64_t count) {
    if (count > body_.size()) broken_off();
    if (encoding_ != PlyEncoding::kAscii) {
      (void)cut(count * size_of(type));
      return;
    }
    for (std::uint64_t i = 0; i < count; ++i) (void)next_text();
  }

 private:
  [[noreturn]] void broken_off() const {
    throw InputError(name_, "elements that break off",
                     "as many as the header says: copy or write the file again");
  }
  std::span<const std::byte> cut(std::size_t count) {
    if (count > body_.size()) broken_off();
    const std::span<const std::byte> bytes = body_.first(count);
    body_ = body_.subspan(count);
    return bytes;
  }
  double next_text() {
    const std::string_view text(reinterpret_cast<const char*>(body_.data()), body_.size());
    // `find_first_of` looks for each of the four by itself.
    const auto is_blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; };
    std::size_t begin = 0;
    while (begin < text.size() && is_blank(text[begin])) ++begin;
    if (begin == text.size()) broken_off();
    std::size_t end = begin + 1;
    while (end < text.size() && !is_blank(text[end])) ++end;
    const std::optional<double> value = parse_number(text.substr(begin, end - begin));
    if (!value) throw InputError(name_, quoted(text.substr(begin, end - begin)), "a number");
    body_ = body_.subspan(end);
    return *value;
  }

  std::span<const std::byte> body_;
  PlyEncoding encoding_;
  const std::string& name_;
};

/// Takes one list from the stream, its length first.
void skip_list(const Property& property, NumberStream& stream, const std::string& name) {
  const double length = stream.next(*property.length_type);
  if (!(length >= 0.0 && length <= 4294967295.0) || length != std::floor(length)) {
    throw InputError(name, "a list of " + std::to_string(length) + " numbers",
                     "a whole length >= 0");
  }
  stream.skip(property.field.type, static_cast<std::uint64_t>(length));
}

/// Fewest bytes that one instance of an element takes.
std::size_t min_bytes(const Element& element, const NumberStream& stream) {
  std::size_t bytes = 0;
  for (const Property& property : element.properties) {
    bytes += stream.min_bytes(property.length_type.value_or(property.field.type));
  }
  return bytes;
}

/// Refuses counts that the bytes left cannot hold, before any loop or allocation goes by them.
void check_count(const Element& element, const NumberStream& stream, const std::string& name) {
  const std::size_t bytes = min_bytes(element, stream);
  // The last number of a text needs no blank behind it.
  if (bytes > 0 && element.count > (stream.bytes_left() + 1) / bytes) {
    throw InputError(name, std::to_string(stream.bytes_left()) + " bytes",
                     "room for " + std::to_string(element.count) + " of element '" +
                         element.name.substr(0, 64) + "': copy or write the file again");
  }
}

void skip_element(const Element& element, NumberStream& stream, const std::string& name) {
  check_count(element, stream, name);
  if (element.properties.empty()) return;
  for (std::uint64_t i = 0; i < element.count; ++i) {
    for (const Property& property : element.properties) {
      if (property.length_type) {
        skip_list(property, stream, name);
      } else {
        stream.skip(property.field.type, 1);
      }
    }
  }
}

std::vector<PointField> fields_of(const Element& element) {
  std::vector<PointField> fields;
  for (const Property& property : element.properties) fields.push_back(property.field);
  return fields;
}

/// @param make  of the table, or of what else takes the points, from their fields and roles: called
/// once these bytes are known to hold so many of them. @return what it made, filled.
template <typename Make>
auto read_vertices(const Element& element, NumberStream& stream, const std::string& name,
                   const Make& make) {
  const std::vector<PointField> fields = fields_of(element);
  const std::vector<Role> roles = roles_of(fields, name);
  check_count(element, stream, name);
  auto table = make(fields, roles);
  for (std::size_t point = 0; point < element.count; ++point) {
    for (std::size_t p = 0; p < roles.size(); ++p) {
      const Property& property = element.properties[p];
      if (property.length_type) {
        skip_list(property, stream, name);
      } else {
        table.set(roles[p], point, stream.next(property.field.type));
      }
    }
    if ((point + 1) % kRowsAtOnce == 0 || point + 1 == element.count) table.reached(point + 1);
  }
  return table;
}

/// The element `vertex`, and the numbers from there on.
struct Vertices {
  const Element* element;
  NumberStream stream;
};

Vertices find_vertices(std::span<const std::byte> bytes, const PlyHeader& header,
                       const std::string& name) {
  NumberStream stream(bytes.subspan(header.body), header.encoding, name);
  for (const Element& element : header.elements) {
    if (element.name == "vertex") return {&element, stream};
    skip_element(element, stream, name);
  }
  throw InputError(name, "no element 'vertex'", "one: write the points as vertices");
}

}  // namespace

DecodedScan decode_ply(std::span<const std::byte> bytes, const std::string& name,
                       std::size_t max_points, std::optional<std::int64_t> stamp_ns) {
  const PlyHeader header = parse_ply_header(header_part(bytes), name);
  auto [element, stream] = find_vertices(bytes, header, name);
  check_point_count(element->count, max_points, name);
  const std::size_t points = element->count;
  return read_vertices(*element, stream, name,
                       [points, stamp_ns](const auto& fields, const auto& roles) {
                         return PointTable(fields, roles, points, stamp_ns);
                       })
      .finish();
}

CloudSummary stream_ply(std::span<const std::byte> bytes, const std::string& name,
                        const CloudStream::Take& take) {
  const PlyHeader header = parse_ply_header(header_part(bytes), name);
  auto [element, stream] = find_vertices(bytes, header, name);
  const std::size_t held = std::min<std::size_t>(element->count, kRowsAtOnce);
  CloudSummary summary =
      read_vertices(*element, stream, name, [&, held](const auto& fields, const auto& roles) {
        return CloudStream(fields, roles, held, take);
      }).summary();
  // Text has as many digits as it was written with.
  if (header.encoding == PlyEncoding::kAscii) summary.single_precision = false;
  return summary;
}

void check_ply_header(std::span<const std::byte> head, const std::string& name) {
  const PlyHeader header = parse_ply_header(header_part(head), name);
  const auto vertex = std::find_if(header.elements.begin(), header.elements.end(),
                                   [](const Element& each) { return each.name == "vertex"; });
  if (vertex == header.elements.end())
    throw InputError(name, "no element 'vertex'", "one: write the points as vertices");
  (void)roles_of(fields_of(*vertex), name);
}

}  // namespace stillmap::maps
