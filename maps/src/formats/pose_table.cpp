#include "formats/pose_table.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cctype>
#include <initializer_list>
#include <numbers>
#include <span>
#include <utility>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

/// A column's name in small letters, without its unit: "Position.X [m]" is "position_x".
struct ColumnName {
  std::string name;
  std::string unit;
  /// As the file has it.
  std::string_view text;
};

ColumnName parse_column_name(std::string_view cell) {
  ColumnName column;
  column.text = cell;
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
       {"_deg", "_degree", "_degrees", "_rad", "_radian", "_radians", "_ns", "_nsec", "_nsecs",
        "_nanosec", "_nanosecs", "_nanoseconds", "_us", "_ms", "_s", "_sec", "_secs", "_seconds",
        "_m"}) {
    if (!column.unit.empty() || !column.name.ends_with(suffix)) continue;
    column.unit = suffix.substr(1);
    column.name.resize(column.name.size() - suffix.size());
  }
  return column;
}

/// Cells of a header; a unit behind a blank belongs to the name before it: "tx [m] ty [m]".
std::vector<std::string_view> header_cells(std::string_view line) {
  const std::vector<std::string_view> cells = split_cells(line, separator_of(line));
  std::vector<std::string_view> joined;
  for (const std::string_view cell : cells) {
    const bool is_unit = cell.starts_with('[') || cell.starts_with('(');
    if (!is_unit || joined.empty()) {
      joined.push_back(cell);
      continue;
    }
    const char* const begin = joined.back().data();
    joined.back() = {begin, static_cast<std::size_t>(cell.data() + cell.size() - begin)};
  }
  return joined;
}

using Patterns = std::span<const std::string_view>;

class HeaderColumns {
 public:
  HeaderColumns(const std::vector<std::string_view>& cells, const std::string& where)
      : where_(where) {
    for (const std::string_view cell : cells) columns_.push_back(parse_column_name(cell));
  }

  /// Columns named as the first of the patterns that names one. `$` stands for the axis; what
  /// begins with `*` may have a prefix, as "field_pose_pose_position_x", where no column has the
  /// name alone.
  [[nodiscard]] std::vector<std::size_t> all(Patterns patterns, char axis = ' ') const {
    std::vector<std::size_t> found;
    for (const bool with_prefix : {false, true}) {
      for (std::string_view pattern : patterns) {
        const bool may_have_prefix = pattern.starts_with('*');
        if (with_prefix && !may_have_prefix) continue;
        if (may_have_prefix) pattern.remove_prefix(1);
        std::string wanted((with_prefix ? "_" : "") + std::string(pattern));
        std::replace(wanted.begin(), wanted.end(), '$', axis);
        for (std::size_t i = 0; i < columns_.size(); ++i) {
          const std::string& name = columns_[i].name;
          if (with_prefix ? name.ends_with(wanted) : name == wanted) found.push_back(i);
        }
        if (!with_prefix && !found.empty()) return found;
      }
    }
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
  }

  /// The first; more than one are kept for `require_single`.
  [[nodiscard]] std::optional<std::size_t> find(Patterns patterns, char axis = ' ') {
    std::vector<std::size_t> found = all(patterns, axis);
    if (found.empty()) return std::nullopt;
    const std::size_t first = found.front();
    if (found.size() > 1) several_ = std::move(found);
    return first;
  }
  /// @throws InputError where two columns could be meant.
  void require_single() const {
    if (several_.empty()) return;
    throw InputError(where_,
                     "the columns " + quoted(columns_[several_[0]].text) + " and " +
                         quoted(columns_[several_[1]].text),
                     "one of them: remove or rename the other");
  }

  [[nodiscard]] const ColumnName& operator[](std::size_t i) const { return columns_[i]; }

  [[noreturn]] void refuse_unit(std::size_t i, const std::string& wanted) const {
    throw InputError(where_, "the column " + quoted(columns_[i].text),
                     wanted + ": convert the values, and correct the unit in the header");
  }

 private:
  const std::string& where_;
  std::vector<ColumnName> columns_;
  std::vector<std::size_t> several_;
};

constexpr std::array<std::string_view, 9> kPositions{
    "$", "t$", "p$", "p_$", "t_$", "pos_$", "*position_$", "*translation_$", "*p_rs_r_$"};
constexpr std::array<std::string_view, 7> kQuaternions{
    "q$", "q_$", "quat_$", "quaternion_$", "*orientation_$", "*rotation_$", "*q_rs_$"};
constexpr std::array<std::string_view, 1> kHeaderStamps{"*header_stamp"};
constexpr std::array<std::string_view, 5> kStamps{"*timestamp", "*stamp", "*time", "t", "ts"};
constexpr std::array<std::string_view, 3> kSeconds{"sec", "secs", "seconds"};
constexpr std::array<std::string_view, 5> kNanoseconds{"nsec", "nsecs", "nanosec", "nanosecs",
                                                       "nanoseconds"};
constexpr std::array<std::string_view, 8> kNumbers{"frame", "frame_index", "index",   "idx",
                                                   "id",    "scan",        "scan_id", "number"};

bool has_word(const std::string& word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

bool find_position(HeaderColumns& header, PoseColumns& columns) {
  constexpr std::array<char, 3> kAxes{'x', 'y', 'z'};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto column = header.find(kPositions, kAxes[i]);
    if (!column) return false;
    columns.position[i] = *column;
  }
  return true;
}

bool find_rotation(HeaderColumns& header, PoseColumns& columns) {
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
  }
  return true;
}

void take_units(const HeaderColumns& header, PoseColumns& columns) {
  for (const std::size_t column : columns.position)
    if (!has_word(header[column].unit, {"", "m", "meter", "meters", "metre", "metres"}))
      header.refuse_unit(column, "positions in metres");
  for (std::size_t i = 0; i < 3 && !columns.is_quaternion; ++i) {
    const std::size_t column = columns.rotation[i];
    const std::string& unit = header[column].unit;
    if (unit.empty()) continue;
    if (has_word(unit, {"rad", "radian", "radians"}))
      columns.angle_unit_rad[i] = 1.0;
    else if (has_word(unit, {"deg", "degree", "degrees", "\xC2\xB0", "\xB0"}))
      columns.angle_unit_rad[i] = std::numbers::pi / 180.0;
    else
      header.refuse_unit(column, "angles in rad or deg");
  }
}

std::optional<StampUnit> stamp_unit_of(const HeaderColumns& header, std::size_t column) {
  const std::string& unit = header[column].unit;
  if (unit.empty()) return std::nullopt;
  if (has_word(unit, {"ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds"}))
    return StampUnit::kNanoseconds;
  if (has_word(unit, {"us", "usec", "\xC2\xB5s", "microseconds"})) return StampUnit::kMicroseconds;
  if (has_word(unit, {"ms", "msec", "milliseconds"})) return StampUnit::kMilliseconds;
  if (has_word(unit, {"s", "sec", "secs", "seconds"})) return StampUnit::kSeconds;
  header.refuse_unit(column, "stamps in s, ms, us or ns");
}

/// A stamp of these names, or seconds and nanoseconds of one name: "timestamp_sec,timestamp_nsec".
bool find_stamp_named(HeaderColumns& header, Patterns names, PoseColumns& columns) {
  const std::vector<std::size_t> found = header.all(names);
  if (found.size() == 2 && header[found[0]].name == header[found[1]].name &&
      stamp_unit_of(header, found[0]) == StampUnit::kSeconds &&
      stamp_unit_of(header, found[1]) == StampUnit::kNanoseconds) {
    columns.stamp = found[0];
    columns.nanoseconds = found[1];
    return true;
  }
  columns.stamp = header.find(names);
  if (columns.stamp) columns.stamp_unit = stamp_unit_of(header, *columns.stamp);
  return columns.stamp.has_value();
}

void find_stamp(HeaderColumns& header, PoseColumns& columns) {
  if (find_stamp_named(header, kHeaderStamps, columns)) return;
  if (find_stamp_named(header, kStamps, columns)) return;
  columns.stamp = header.find(kSeconds);
  columns.nanoseconds = header.find(kNanoseconds);
  if (columns.stamp && columns.nanoseconds) return;
  columns.stamp_unit = columns.stamp ? StampUnit::kSeconds : StampUnit::kNanoseconds;
  if (!columns.stamp) columns.stamp = std::exchange(columns.nanoseconds, std::nullopt);
  if (!columns.stamp) columns.number = header.find(kNumbers);
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

std::size_t PoseColumns::last() const {
  std::size_t last = *std::max_element(position.begin(), position.end());
  for (std::size_t i = 0; i < (is_quaternion ? 4U : 3U); ++i) last = std::max(last, rotation[i]);
  for (const auto& column : {stamp, nanoseconds, number}) last = std::max(last, column.value_or(0));
  return last;
}

std::optional<PoseColumns> parse_pose_header(std::string_view line, const std::string& where) {
  while (!line.empty() && (line.front() == '#' || line.front() == '%' || line.front() == ' '))
    line.remove_prefix(1);
  const std::vector<std::string_view> cells = header_cells(line);
  constexpr std::size_t kMostCellsOfHeader = 256;
  if (cells.size() > kMostCellsOfHeader) return std::nullopt;
  HeaderColumns header(cells, where);
  PoseColumns columns;
  columns.count = cells.size();
  if (!find_position(header, columns) || !find_rotation(header, columns)) return std::nullopt;
  take_units(header, columns);
  find_stamp(header, columns);
  header.require_single();
  return columns;
}

}  // namespace stillmap::maps
