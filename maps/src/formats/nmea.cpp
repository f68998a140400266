#include "formats/nmea.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

#include "formats/pose_table.hpp"

namespace stillmap::maps {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kDayNs = 86'400 * kSecondNs;

/// "$GPGGA,...*5C" without `$` and checksum; nothing where the checksum is another.
std::optional<std::string_view> sentence_of(std::string_view line) {
  const std::size_t end = line.find('*');
  const std::string_view sentence = line.substr(0, end);
  if (end == std::string_view::npos) return sentence;
  unsigned sum = 0;
  for (const char c : sentence) sum ^= static_cast<unsigned char>(c);
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  const std::string expected{kDigits[sum >> 4U & 15U], kDigits[sum & 15U]};
  std::string found(line.substr(end + 1, 2));
  for (char& c : found) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  if (found != expected) return std::nullopt;
  return sentence;
}

/// "hhmmss.sss" since midnight.
std::optional<std::int64_t> time_of_day(std::string_view text) {
  if (text.size() < 6) return std::nullopt;
  const auto hours = parse_count(text.substr(0, 2)), minutes = parse_count(text.substr(2, 2));
  const auto seconds_ns = parse_stamp_ns(text.substr(4));
  // 60: a leap second.
  if (!hours || !minutes || !seconds_ns || *hours > 23 || *minutes > 59 || *seconds_ns < 0 ||
      *seconds_ns >= 61 * kSecondNs)
    return std::nullopt;
  return static_cast<std::int64_t>(*hours * 3600 + *minutes * 60) * kSecondNs + *seconds_ns;
}

std::optional<std::int64_t> day_of(std::string_view day, std::string_view month,
                                   std::string_view year) {
  const auto d = parse_count(day), m = parse_count(month), y = parse_count(year);
  if (!d || !m || !y || *d > 31 || *m > 12 || *y > 2200) return std::nullopt;
  // GPS began in 1980.
  const std::uint64_t full_year = *y < 80 ? 2000 + *y : *y < 100 ? 1900 + *y : *y;
  const std::chrono::year_month_day date{std::chrono::year(static_cast<int>(full_year)),
                                         std::chrono::month(static_cast<unsigned>(*m)),
                                         std::chrono::day(static_cast<unsigned>(*d))};
  if (!date.ok()) return std::nullopt;
  return std::chrono::sys_days(date).time_since_epoch().count() * kDayNs;
}

/// "ddmm.mmmm" and its hemisphere.
std::optional<double> angle_of(std::string_view text, std::string_view side) {
  const auto value = parse_number(text);
  if (!value || !(*value >= 0.0 && *value <= 18'000.0) || side.size() != 1) return std::nullopt;
  const double degrees = std::floor(*value / 100.0);
  const double angle = degrees + (*value - 100.0 * degrees) / 60.0;
  return side == "S" || side == "W" ? -angle : angle;
}

/// The cells of the sentence in a line; of a whole GGA there are at least 13.
struct Sentence {
  std::string_view kind;
  std::vector<std::string_view> cells;
  std::size_t size = 0;
  /// Of another checksum.
  bool is_broken = false;
};

std::optional<Sentence> parse_sentence(std::string_view line) {
  const std::size_t begin = line.find('$');
  if (begin == std::string_view::npos) return std::nullopt;
  while (line.ends_with('\r') || line.ends_with(' ')) line.remove_suffix(1);
  Sentence sentence;
  const auto text = sentence_of(line.substr(begin + 1));
  sentence.is_broken = !text;
  if (!text) return sentence;
  sentence.cells = split_cells(*text, ',');
  if (sentence.cells.empty() || sentence.cells[0].size() < 5) return std::nullopt;
  sentence.size = sentence.cells.size();
  sentence.kind = sentence.cells[0].substr(sentence.cells[0].size() - 3);
  sentence.cells.resize(std::max<std::size_t>(sentence.size, 15));
  return sentence;
}

/// Of RMC and ZDA: date and time of day.
std::optional<std::int64_t> date_of(const Sentence& sentence) {
  const auto& cells = sentence.cells;
  std::optional<std::int64_t> day_ns;
  if (sentence.kind == "RMC" && cells[9].size() == 6)
    day_ns = day_of(cells[9].substr(0, 2), cells[9].substr(2, 2), cells[9].substr(4, 2));
  if (sentence.kind == "ZDA") day_ns = day_of(cells[2], cells[3], cells[4]);
  const auto of_day_ns = day_ns ? time_of_day(cells[1]) : std::nullopt;
  if (!of_day_ns) return std::nullopt;
  return *day_ns + *of_day_ns;
}

void for_each_sentence(std::string_view text, const std::function<bool(const Sentence&)>& take) {
  constexpr std::size_t kMostLine = 1024;
  while (const auto line = take_line(text)) {
    if (line->size() > kMostLine) continue;
    const auto sentence = parse_sentence(*line);
    if (sentence && !take(*sentence)) return;
  }
}

class NmeaReader {
 public:
  NmeaReader(std::int64_t near_ns, const std::function<void(const NmeaFix&)>& take)
      : last_ns_(near_ns), take_fix_(take) {}

  void take(const Sentence& sentence) {
    if (sentence.is_broken) {
      ++track_.broken;
    } else if (sentence.kind == "GGA") {
      take_position(sentence);
    } else if (const auto date_ns = date_of(sentence)) {
      track_.has_date = true;
      last_ns_ = *date_ns;
    }
  }

  [[nodiscard]] const NmeaTrack& track() const { return track_; }

 private:
  /// The time of day on the day that brings it nearest to a stamp.
  static std::int64_t nearest(std::int64_t of_day_ns, std::int64_t stamp_ns) {
    const std::int64_t days = (stamp_ns - of_day_ns + kDayNs / 2) / kDayNs;
    return days * kDayNs + of_day_ns;
  }

  void take_position(const Sentence& sentence) {
    // Up to the unit of the geoid separation: a line that was cut before has other numbers.
    constexpr std::size_t kLeastCells = 13;
    const std::vector<std::string_view>& cells = sentence.cells;
    if (sentence.size < kLeastCells) {
      ++track_.broken;
      return;
    }
    const auto of_day_ns = time_of_day(cells[1]);
    const auto quality = parse_count(cells[6]);
    if (!of_day_ns) {
      // A receiver that has not found its satellites yet.
      track_.broken += cells[1].empty() ? 0U : 1U;
      return;
    }
    last_ns_ = nearest(*of_day_ns, last_ns_);
    NmeaFix fix{last_ns_, std::nullopt};
    if (quality && *quality > 0) {
      fix.place = place_of(cells);
      track_.broken += fix.place ? 0U : 1U;
    }
    ++track_.fixes;
    take_fix_(fix);
  }

  std::optional<GeodeticOrigin> place_of(const std::vector<std::string_view>& cells) {
    const auto latitude = angle_of(cells[2], cells[3]), longitude = angle_of(cells[4], cells[5]);
    const auto altitude = parse_number(cells[9]);
    if (!latitude || !longitude || !altitude) return std::nullopt;
    const auto separation = parse_number(cells[11]);
    const GeodeticOrigin place{*latitude, *longitude, *altitude + separation.value_or(0.0)};
    if (!violations(place).empty()) return std::nullopt;
    track_.above_sea += separation ? 0U : 1U;
    return place;
  }

  /// Of the sentence before.
  std::int64_t last_ns_;
  const std::function<void(const NmeaFix&)>& take_fix_;
  NmeaTrack track_;
};

}  // namespace

NmeaTrack read_nmea(const std::filesystem::path& file, std::int64_t near_ns,
                    const std::function<void(const NmeaFix&)>& take) {
  constexpr std::uintmax_t kMostBytes = std::uintmax_t{1} << 30U;
  const std::string text = read_text(file, kMostBytes);
  std::optional<std::int64_t> first_date_ns;
  for_each_sentence(text, [&](const Sentence& sentence) {
    if (!sentence.is_broken) first_date_ns = date_of(sentence);
    return !first_date_ns;
  });
  NmeaReader reader(first_date_ns.value_or(near_ns), take);
  for_each_sentence(text, [&](const Sentence& sentence) {
    reader.take(sentence);
    return true;
  });
  if (reader.track().fixes == 0)
    throw InputError(file.string(), "no GGA sentence that can be read",
                     "a log of NMEA 0183 with $..GGA: give another file");
  return reader.track();
}

}  // namespace stillmap::maps
