#include <stillmap/maps/imu.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "formats/file_reader.hpp"
#include "formats/pose_table.hpp"

namespace stillmap::maps {
namespace {

constexpr std::string_view kImuHeader = "stamp_ns,wx,wy,wz,ax,ay,az";
constexpr std::array<std::string_view, 7> kImuColumns{"stamp_ns", "wx", "wy", "wz",
                                                      "ax",       "ay", "az"};

/// 107 for each of `kMostImuReadings`; a line with all digits of a double has some 140.
constexpr std::uintmax_t kMostImuFileBytes = std::uintmax_t{1} << 30U;

/// The file's first line without a byte order mark; lines of columns are short.
std::string first_line(const std::filesystem::path& file) {
  std::array<std::byte, 4096> bytes{};
  const std::size_t size = FileReader(file).read_at(0, bytes);
  std::string_view line(reinterpret_cast<const char*>(bytes.data()), size);
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (line.starts_with(kByteOrderMark)) line.remove_prefix(kByteOrderMark.size());
  return std::string(line.substr(0, line.find('\n')));
}

/// Where each of `kImuColumns` stands.
std::array<std::size_t, 7> places_of(std::string_view header, const std::string& file) {
  const std::vector<std::string_view> cells = split_cells(header, ',');
  std::array<std::size_t, 7> places{};
  for (std::size_t i = 0; i < kImuColumns.size(); ++i) {
    const auto at = std::ranges::find(cells, kImuColumns[i]);
    if (at == cells.end())
      throw InputError(file, "no column " + std::string(kImuColumns[i]) + " in " + quoted(header),
                       "a first line that names the columns " + std::string(kImuHeader));
    places[i] = static_cast<std::size_t>(at - cells.begin());
  }
  return places;
}

}  // namespace

bool has_imu_columns(const std::filesystem::path& file) {
  const std::string line = first_line(file);
  const std::vector<std::string_view> cells = split_cells(line, ',');
  return std::ranges::all_of(kImuColumns, [&](std::string_view name) {
    return std::ranges::find(cells, name) != cells.end();
  });
}

std::vector<ImuReading> read_imu_csv(const std::filesystem::path& file, std::size_t most_readings) {
  const std::string text = read_text(file, kMostImuFileBytes);
  std::string_view rest = text;
  const auto header = take_line(rest);
  const std::array<std::size_t, 7> places = places_of(header.value_or(""), file.string());
  const std::size_t columns = *std::ranges::max_element(places) + 1;
  std::vector<ImuReading> readings;
  for (std::size_t number = 2; const auto line = take_line(rest); ++number) {
    if (split_fields(*line, 1).empty()) continue;
    const std::vector<std::string_view> cells = split_cells(*line, ',');
    if (cells.size() < columns)
      throw InputError(place(file, number), quoted(*line),
                       std::to_string(columns) + " columns, as the first line names");
    if (readings.size() == most_readings)
      throw InputError(file.string(), "more than " + std::to_string(most_readings) + " readings",
                       "fewer: split the drive, or keep every second reading");
    ImuReading& reading = readings.emplace_back();
    const auto number_in = [&](std::size_t name) {
      const auto value = parse_number(cells[places[name]]);
      if (!value)
        throw InputError(place(file, number), quoted(cells[places[name]]),
                         "a number as " + std::string(kImuColumns[name]));
      return static_cast<float>(*value);
    };
    const std::string_view stamp = cells[places[0]];
    const bool is_negative = stamp.starts_with('-');
    const auto count = parse_count(stamp.substr(is_negative ? 1 : 0));
    if (!count || *count > std::uint64_t{kMostImuStampNs})
      throw InputError(place(file, number), quoted(stamp),
                       "a whole number of ns as stamp_ns, at most 4e18");
    reading.stamp_ns = (is_negative ? -1 : 1) * static_cast<std::int64_t>(*count);
    for (int axis = 0; axis < 3; ++axis) {
      reading.rate_radps[axis] = number_in(1 + static_cast<std::size_t>(axis));
      reading.force_mps2[axis] = number_in(4 + static_cast<std::size_t>(axis));
    }
  }
  return readings;
}

}  // namespace stillmap::maps
