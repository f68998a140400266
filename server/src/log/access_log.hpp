#pragma once

#include <cstdint>
#include <string_view>

namespace stillmap::server {

/// One request that was answered. What names the client stands in the thread's `LogContext`.
/// There is no field for a header or a query on purpose: keys travel in them.
struct AccessRecord {
  std::string_view method = {};
  /// The route's pattern, `/v1/maps/{map}/localize`; empty when none was met.
  std::string_view route = {};
  int status = 0;
  /// Bodies, unpacked.
  std::uint64_t bytes_in = 0;
  std::uint64_t bytes_out = 0;
  double milliseconds = 0.0;
};

/// Writes a line of level info, of level debug for probes and metrics, which come every second. One
/// of 500 and above is a warning, written in any case.
void log_access(const AccessRecord& record);

/// Whether requests below 500 have lines at level info; else they are of level debug. True at
/// first. Safe from any thread.
void set_request_lines(bool wanted);

/// The record that this thread is logging right now; nullptr when it logs anything else.
[[nodiscard]] const AccessRecord* current_access_record();

}  // namespace stillmap::server
