#include "formats/pose_table.hpp"

#include <algorithm>
#include <cctype>
#include <span>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

/// A column's name in small letters, without its unit: "Position.X [m]" is "position_x".
struct ColumnName {
  std::string name;
  std::string unit;
};

ColumnName parse_column_name(std::string_view cell) {
  ColumnName column;
  bool in_unit = false;
  for (const char c : cell) {
    if (c == '[' || c == '(') {
      in_unit = true;
    } else if (c != ']' && c != ')') {
      const bool is_part = c == '.' || c == '/' || c == ' ' || c == '-';
      const char small =
          is_part ? '_' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      (in_unit ? column.unit : column.name) += small;
    }
  }
  while (!column.name.empty() && column.name.back() == '_') column.name.pop_back();
  for (const std::string_view suffix :
       {"_deg", "_rad", "_ns", "_nsec", "_us", "_ms", "_s", "_sec", "_m"}) {
    if (!column.unit.empty() || !column.name.ends_with(suffix)) continue;
    // "header.stamp.sec" is a part of a stamp, not its unit.
    if (column.name.ends_with("stamp_sec") || column.name.ends_with("stamp_nsec")) continue;
    column.unit = suffix.substr(1);
    column.name.resize(column.name.size() - suffix.size());
  }
  return column;
}

/// Whether a name is one of the patterns, in which `$` stands for the axis; a pattern that begins
/// with `*` may have a prefix, as "field_pose_pose_position_x".
bool is_named(const std::string& name, std::span<const std::string_view> patterns, char axis) {
  return std::any_of(patterns.begin(), patterns.end(), [&](std::string_view pattern) {
    const bool may_have_prefix = pattern.starts_with('*');
    if (may_have_prefix) pattern.remove_prefix(1);
    std::string wanted(pattern);
    std::replace(wanted.begin(), wanted.end(), '$', axis);
    return name == wanted || (may_have_prefix && name.ends_with("_" + wanted));
  });
}

class HeaderColumns {
 public:
  explicit HeaderColumns(const std::vector<std::string_view>& cells) {
    for (const std::string_view cell : cells) columns_.push_back(parse_column_name(cell));
  }

  [[nodiscard]] std::optional<std::size_t> find(std::span<const std::string_view> patterns,
                                                char axis = ' ') const {
    for (std::size_t i = 0; i < columns_.size(); ++i)
      if (is_named(columns_[i].name, patterns, axis)) return i;
    return std::nullopt;
  }
  [[nodiscard]] const std::string& unit(std::size_t i) const { return columns_[i].unit; }

 private:
  std::vector<ColumnName> columns_;
};

constexpr std::array<std::string_view, 9> kPositions{
    "$", "t$", "p$", "p_$", "t_$", "pos_$", "*position_$", "*translation_$", "*p_rs_r_$"};
constexpr std::array<std::string_view, 7> kQuaternions{
    "q$", "q_$", "quat_$", "quaternion_$", "*orientation_$", "*rotation_$", "*q_rs_$"};
constexpr std::array<std::string_view, 1> kHeaderStamps{"*header_stamp"};
constexpr std::array<std::string_view, 5> kStamps{"stamp", "timestamp", "time", "t", "ts"};
constexpr std::array<std::string_view, 5> kSeconds{"*stamp_sec", "*stamp_secs", "sec", "secs",
                                                   "seconds"};
constexpr std::array<std::string_view, 6> kNanoseconds{
    "*stamp_nsec", "*stamp_nsecs", "*stamp_nanosec", "nsec", "nsecs", "nanosec"};
constexpr std::array<std::string_view, 8> kNumbers{"frame", "frame_index", "index",   "idx",
                                                   "id",    "scan",        "scan_id", "number"};

bool find_rotation(const HeaderColumns& header, PoseColumns& columns) {
  constexpr std::array<char, 4> kAxes{'x', 'y', 'z', 'w'};
  std::size_t found = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto column = header.find(kQuaternions, kAxes[i]);
    if (column) columns.rotation[i] = *column;
    found += column ? 1 : 0;
  }
  if (found == 4) return true;
  constexpr std::array<std::string_view, 3> kAngles{"*roll", "*pitch", "*yaw"};
  columns.is_quaternion = false;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto column = header.find(std::span(&kAngles[i], 1));
    if (!column) return false;
    columns.rotation[i] = *column;
    columns.in_degrees = header.unit(*column).starts_with("deg");
    columns.has_angle_unit = !header.unit(*column).empty();
  }
  return true;
}

std::optional<StampUnit> unit_named(const std::string& unit) {
  if (unit == "ns" || unit == "nsec") return StampUnit::kNanoseconds;
  if (unit == "us") return StampUnit::kMicroseconds;
  if (unit == "ms") return StampUnit::kMilliseconds;
  if (unit == "s" || unit == "sec") return StampUnit::kSeconds;
  return std::nullopt;
}

void find_stamp(const HeaderColumns& header, PoseColumns& columns) {
  columns.stamp = header.find(kSeconds);
  columns.nanoseconds = header.find(kNanoseconds);
  if (columns.stamp && columns.nanoseconds) return;
  columns.nanoseconds.reset();
  columns.stamp = header.find(kHeaderStamps);
  if (!columns.stamp) columns.stamp = header.find(kStamps);
  if (columns.stamp)
    columns.stamp_unit = unit_named(header.unit(*columns.stamp));
  else
    columns.number = header.find(kNumbers);
}

}  // namespace

std::vector<std::string_view> split_cells(std::string_view line, char separator) {
  if (separator == ' ') return split_fields(line);
  const auto trimmed = [](std::string_view cell) {
    const auto cut = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '"'; };
    while (!cell.empty() && cut(cell.front())) cell.remove_prefix(1);
    while (!cell.empty() && cut(cell.back())) cell.remove_suffix(1);
    return cell;
  };
  std::vector<std::string_view> cells;
  for (;;) {
    const std::size_t end = line.find(separator);
    cells.push_back(trimmed(line.substr(0, end)));
    if (end == std::string_view::npos) break;
    line.remove_prefix(end + 1);
  }
  // One behind the last separator.
  if (cells.back().empty()) cells.pop_back();
  return cells;
}

char separator_of(std::string_view line) {
  for (const char separator : {';', ','})
    if (line.find(separator) != std::string_view::npos) return separator;
  return ' ';
}

std::optional<std::int64_t> parse_stamp(std::string_view text, StampUnit unit) {
  if (unit == StampUnit::kSeconds) return parse_stamp_ns(text);
  // Its exponent and that of the unit.
  const std::size_t mark = std::min(text.find_first_of("eE"), text.size());
  std::int64_t exponent = 0;
  if (mark < text.size()) {
    std::string_view digits = text.substr(mark + 1);
    const bool is_negative = digits.starts_with('-');
    if (is_negative || digits.starts_with('+')) digits.remove_prefix(1);
    const auto count = parse_count(digits);
    if (!count || *count > 1000) return std::nullopt;
    exponent = is_negative ? -static_cast<std::int64_t>(*count) : static_cast<std::int64_t>(*count);
  }
  return parse_stamp_ns(std::string(text.substr(0, mark)) + "e" +
                        std::to_string(exponent + static_cast<int>(unit)));
}

StampUnit unit_of_stamp(std::string_view text) {
  const std::optional<double> value = parse_number(text);
  if (!value || !(*value >= 1e11)) return StampUnit::kSeconds;
  if (*value >= 1e17) return StampUnit::kNanoseconds;
  return *value >= 1e14 ? StampUnit::kMicroseconds : StampUnit::kMilliseconds;
}

std::optional<PoseColumns> parse_pose_header(std::string_view line) {
  while (!line.empty() && (line.front() == '#' || line.front() == '%' || line.front() == ' '))
    line.remove_prefix(1);
  const std::vector<std::string_view> cells = split_cells(line, separator_of(line));
  constexpr std::size_t kMostColumns = 256;
  if (cells.size() > kMostColumns) return std::nullopt;
  const HeaderColumns header(cells);
  PoseColumns columns;
  columns.count = cells.size();
  constexpr std::array<char, 3> kAxes{'x', 'y', 'z'};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto column = header.find(kPositions, kAxes[i]);
    if (!column) return std::nullopt;
    columns.position[i] = *column;
  }
  if (!find_rotation(header, columns)) return std::nullopt;
  find_stamp(header, columns);
  return columns;
}

}  // namespace stillmap::maps
