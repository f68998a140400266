#pragma once

#include <stillmap/maps/drive.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>

namespace stillmap::maps {

/// A position in a log of NMEA 0183.
struct NmeaFix {
  /// UTC, as Unix time.
  std::int64_t stamp_ns = 0;
  /// Nothing where the receiver had no fix.
  std::optional<GeodeticOrigin> place;
};

/// What was found in a log.
struct NmeaTrack {
  std::size_t fixes = 0;
  /// Left out: sentences of another checksum, or whose numbers cannot be read, or that end before
  /// the geoid separation.
  std::size_t broken = 0;
  /// Fixes whose height is above the sea, since the sentence does not say how far the ellipsoid is.
  std::size_t above_sea = 0;
  /// Whether RMC or ZDA tell the date; else it is that of `near_ns`.
  bool has_date = false;
};

/// Reads the GGA sentences of any talker, with the date of RMC or ZDA. What stands before `$` in a
/// line is skipped, as loggers write their own time there. Heights are above the ellipsoid:
/// altitude plus geoid separation. Fixes before the first date have the day that is nearest to it.
/// @param near_ns  a stamp of the drive: dates that nobody tells are those nearest to it.
/// @param take     gets the fixes in the order of the file.
/// @throws InputError for a file without GGA; StorageError.
[[nodiscard]] NmeaTrack read_nmea(const std::filesystem::path& file, std::int64_t near_ns,
                                  const std::function<void(const NmeaFix&)>& take);

}  // namespace stillmap::maps
