#pragma once

#include <cstddef>

namespace stillmap::maps {

/// While it lives, this thread reads no file of a scan that has more points: `read_scan_file` and
/// `Drive::read` throw InputError. For files of others, of which a small one may unpack to many
/// points.
class ScanLimit {
 public:
  explicit ScanLimit(std::size_t max_points);
  ~ScanLimit();
  ScanLimit(const ScanLimit&) = delete;
  ScanLimit& operator=(const ScanLimit&) = delete;

 private:
  std::size_t before_;
};

}  // namespace stillmap::maps
