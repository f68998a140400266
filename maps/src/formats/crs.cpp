#include "formats/crs.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <vector>

#include <stillmap/maps/text.hpp>
#include "formats/point_table.hpp"

namespace stillmap::maps {
namespace {

/// Deeper than any coordinate system goes.
constexpr std::size_t kMostLevels = 16;
constexpr std::size_t kMostNameBytes = 128;
constexpr double kUtmFalseEastingM = 500'000.0;

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

bool is_projected(std::string_view word) {
  return is_one_of(word, {"PROJCS", "PROJCRS", "PROJECTEDCRS"});
}

bool is_vertical(std::string_view word) {
  return is_one_of(word, {"VERT_CS", "VERTCRS", "VERTICALCRS"});
}

/// Names are written with spaces or underscores, small and large.
std::string plain(std::string name) {
  for (char& c : name)
    c = c == '_' ? ' ' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return name;
}

/// "WGS 84 / UTM zone 32N", "WGS_1984_UTM_Zone_32N": the zone.
std::optional<UtmZone> zone_in_name(const std::string& given) {
  const std::string name = plain(given);
  const bool datum = name.starts_with("wgs 84") || name.starts_with("wgs 1984") ||
                     name.starts_with("etrs89") || name.starts_with("etrs 1989") ||
                     name.starts_with("nad83") || name.starts_with("nad 1983");
  constexpr std::string_view kWords = "utm zone ";
  const std::size_t at = name.find(kWords);
  if (!datum || at == std::string::npos) return std::nullopt;
  const std::string_view rest = std::string_view(name).substr(at + kWords.size());
  const std::size_t digits = std::min(rest.find_first_not_of("0123456789"), rest.size());
  const auto number = parse_count(rest.substr(0, digits));
  if (!number || *number < 1 || *number > 60 || digits >= rest.size()) return std::nullopt;
  if (rest[digits] != 'n' && rest[digits] != 's') return std::nullopt;
  return UtmZone{static_cast<int>(*number), rest[digits] == 'n'};
}

/// Goes through the text once, node by node: KEYWORD[value,value,NODE[...]].
class WktReader {
 public:
  explicit WktReader(std::string_view text) : rest_(text) {}

  CoordinateSystem read() {
    std::string word;
    while (!rest_.empty() && levels_.size() < kMostLevels) {
      const char c = rest_.front();
      rest_.remove_prefix(1);
      if (c == '"') {
        add_value(read_quoted());
      } else if (c == '[' || c == '(') {
        levels_.push_back({upper(word), {}});
        word.clear();
      } else if (c == ',' || c == ']' || c == ')') {
        if (!word.empty()) add_value(word);
        word.clear();
        if (c != ',') close();
      } else if (std::isspace(static_cast<unsigned char>(c)) == 0 && c != '\0' &&
                 word.size() < kMostNameBytes) {
        word += c;
      }
    }
    // Some surveys put the zone before the easting (EPSG:4647), and keep the name; and there are
    // more codes of ordinary zones than are known here.
    const bool is_utm_by_name = !has_code_ || false_easting_m_ == kUtmFalseEastingM;
    if (!system_.utm && projected_ && is_utm_by_name) system_.utm = zone_in_name(system_.name);
    if (false_easting_m_ && *false_easting_m_ != kUtmFalseEastingM) system_.utm.reset();
    system_.is_geographic = geographic_ && !projected_;
    return system_;
  }

 private:
  struct Level {
    std::string word;
    std::vector<std::string> values;
  };

  static std::string upper(std::string word) {
    for (char& c : word) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    return word;
  }

  std::string read_quoted() {
    const std::size_t end = std::min(rest_.find('"'), rest_.size());
    std::string text(rest_.substr(0, std::min(end, kMostNameBytes)));
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    return text;
  }

  void add_value(std::string value) {
    if (!levels_.empty() && levels_.back().values.size() < 8)
      levels_.back().values.push_back(std::move(value));
  }

  [[nodiscard]] std::string_view parent() const {
    return levels_.empty() ? std::string_view() : std::string_view(levels_.back().word);
  }

  void close() {
    if (levels_.empty()) return;
    const Level node = std::move(levels_.back());
    levels_.pop_back();
    const std::string name = node.values.empty() ? "" : node.values.front();
    if (is_projected(node.word)) {
      projected_ = true;
      system_.name = name;
    } else if (is_one_of(node.word, {"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS"})) {
      geographic_ = true;
      if (system_.name.empty()) system_.name = name;
    } else if (is_one_of(node.word, {"LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"})) {
      if (system_.name.empty()) system_.name = name;
    } else if (is_vertical(node.word)) {
      system_.vertical_name = name;
    } else if (is_one_of(node.word, {"AUTHORITY", "ID"})) {
      take_code(node);
    } else if (node.word == "PARAMETER" && plain(name) == "false easting") {
      if (node.values.size() > 1) false_easting_m_ = parse_number(node.values[1]);
    } else if (is_one_of(node.word, {"UNIT", "LENGTHUNIT"})) {
      take_unit(node);
    }
  }

  void take_code(const Level& node) {
    if (!is_projected(parent()) || node.values.size() < 2 || node.values[0] != "EPSG") return;
    const auto code = parse_count(node.values[1]);
    if (!code || *code >= 100'000) return;
    has_code_ = true;
    system_.utm = utm_zone_of_epsg(static_cast<int>(*code));
  }

  void take_unit(const Level& node) {
    const bool of_axes = is_projected(parent()) ||
                         is_one_of(parent(), {"LOCAL_CS", "ENGCRS", "CS"}) ||
                         (parent() == "AXIS" && levels_.size() > 1 &&
                          is_projected(levels_[levels_.size() - 2].word));
    if (node.values.size() < 2) return;
    if (of_axes) system_.metres_per_unit = parse_number(node.values[1]);
    const bool of_heights =
        is_vertical(parent()) ||
        (parent() == "AXIS" && levels_.size() > 1 && is_vertical(levels_[levels_.size() - 2].word));
    if (of_heights) system_.vertical_metres_per_unit = parse_number(node.values[1]);
  }

  std::string_view rest_;
  std::vector<Level> levels_;
  CoordinateSystem system_;
  bool projected_ = false;
  bool geographic_ = false;
  /// Of EPSG, known here or not.
  bool has_code_ = false;
  std::optional<double> false_easting_m_;
};

constexpr int kModelType = 1024;
constexpr int kGeographicModel = 2;
constexpr int kProjectedCode = 3072;
constexpr int kLinearUnits = 3076;
constexpr int kVerticalCode = 4096;
constexpr int kVerticalUnits = 4099;
constexpr int kUserDefined = 32767;

/// The units that point clouds come in.
std::optional<double> metres_of(int code) {
  switch (code) {
    case 9001:
      return 1.0;
    case 9002:
      return 0.3048;
    case 9003:
      return 1200.0 / 3937.0;
    default:
      return std::nullopt;
  }
}

}  // namespace

CoordinateSystem read_wkt(std::string_view text) { return WktReader(text).read(); }

CoordinateSystem read_geo_keys(std::span<const std::byte> bytes) {
  const auto number = [&](std::size_t index) {
    return static_cast<int>(read_number(&bytes[2 * index], NumberType::kU16));
  };
  CoordinateSystem system;
  if (bytes.size() < 8) return system;
  const std::size_t keys =
      std::min<std::size_t>(static_cast<std::size_t>(number(3)), (bytes.size() - 8) / 8);
  for (std::size_t i = 0; i < keys; ++i) {
    const int key = number(4 + 4 * i);
    // Values that are not in the directory itself are names.
    if (number(5 + 4 * i) != 0) continue;
    const int value = number(7 + 4 * i);
    if (key == kModelType) system.is_geographic = value == kGeographicModel;
    if (key == kProjectedCode && value != kUserDefined) {
      system.name = "EPSG:" + std::to_string(value);
      system.utm = utm_zone_of_epsg(value);
    }
    if (key == kLinearUnits) system.metres_per_unit = metres_of(value);
    if (key == kVerticalUnits) system.vertical_metres_per_unit = metres_of(value);
    if (key == kVerticalCode) system.vertical_name = "EPSG:" + std::to_string(value);
  }
  return system;
}

}  // namespace stillmap::maps
