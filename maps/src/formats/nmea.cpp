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

class NmeaReader {
 public:
  explicit NmeaReader(std::int64_t near_ns) : near_ns_(near_ns) {}

  void take(std::string_view line) {
    const std::size_t begin = line.find('$');
    if (begin == std::string_view::npos) return;
    while (line.ends_with('\r') || line.ends_with(' ')) line.remove_suffix(1);
    const auto sentence = sentence_of(line.substr(begin + 1));
    if (!sentence) {
      ++track_.broken;
      return;
    }
    std::vector<std::string_view> cells = split_cells(*sentence, ',');
    if (cells.empty() || cells[0].size() < 5) return;
    cells.resize(std::max<std::size_t>(cells.size(), 15));
    const std::string_view kind = cells[0].substr(cells[0].size() - 3);
    if (kind == "GGA") take_position(cells);
    if (kind == "RMC" && cells[9].size() == 6)
      take_date(day_of(cells[9].substr(0, 2), cells[9].substr(2, 2), cells[9].substr(4, 2)),
                cells[1]);
    if (kind == "ZDA") take_date(day_of(cells[2], cells[3], cells[4]), cells[1]);
  }

  [[nodiscard]] NmeaTrack track() { return std::move(track_); }

 private:
  void take_date(const std::optional<std::int64_t>& day_ns, std::string_view time) {
    const auto of_day_ns = time_of_day(time);
    if (!day_ns || !of_day_ns) return;
    const bool is_first = !track_.has_date;
    track_.has_date = true;
    last_ns_ = *day_ns + *of_day_ns;
    // Those before the first date had that of the drive.
    if (is_first)
      for (NmeaFix& fix : track_.fixes) fix.stamp_ns = nearest(fix.stamp_ns % kDayNs, *last_ns_);
  }

  /// The time of day on the day that brings it nearest to a stamp.
  static std::int64_t nearest(std::int64_t of_day_ns, std::int64_t stamp_ns) {
    const std::int64_t days = (stamp_ns - of_day_ns + kDayNs / 2) / kDayNs;
    return days * kDayNs + of_day_ns;
  }

  void take_position(const std::vector<std::string_view>& cells) {
    const auto of_day_ns = time_of_day(cells[1]);
    const auto quality = parse_count(cells[6]);
    if (!of_day_ns) {
      // A receiver that has not found its satellites yet.
      track_.broken += cells[1].empty() ? 0U : 1U;
      return;
    }
    last_ns_ = nearest(*of_day_ns, last_ns_.value_or(near_ns_));
    NmeaFix fix{*last_ns_, std::nullopt};
    if (quality && *quality > 0) {
      fix.place = place_of(cells);
      track_.broken += fix.place ? 0U : 1U;
    }
    track_.fixes.push_back(fix);
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

  std::int64_t near_ns_;
  /// Of the sentence before.
  std::optional<std::int64_t> last_ns_;
  NmeaTrack track_;
};

}  // namespace

NmeaTrack read_nmea(const std::filesystem::path& file, std::int64_t near_ns) {
  constexpr std::uintmax_t kMostBytes = std::uintmax_t{1} << 30U;
  const std::string text = read_text(file, kMostBytes);
  NmeaReader reader(near_ns);
  std::string_view rest = text;
  while (const auto line = take_line(rest)) {
    constexpr std::size_t kMostLine = 1024;
    if (line->size() <= kMostLine) reader.take(*line);
  }
  NmeaTrack track = reader.track();
  if (track.fixes.empty())
    throw InputError(file.string(), "no GGA sentence that can be read",
                     "a log of NMEA 0183 with $..GGA: give another file");
  return track;
}

}  // namespace stillmap::maps
