#pragma once

#include "jobs/child_process.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace stillmap::server {

/// What a job's program says, in a file of at most some 1.1 MiB over all attempts: the first part
/// as it comes, of the rest the end. A full disk loses lines, never the job. For one thread.
class JobLog {
 public:
  static constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 20U;
  static constexpr std::size_t kEndBytes = std::size_t{64} << 10U;

  /// Goes on behind what is there.
  explicit JobLog(const std::filesystem::path& file);
  /// As `close`.
  ~JobLog();
  JobLog(const JobLog&) = delete;
  JobLog& operator=(const JobLog&) = delete;

  void append(std::string_view text);
  /// Of all that came, without what cannot be printed; at most 300 bytes. Empty when none has.
  [[nodiscard]] std::string last_line() const;
  /// Writes the end that was kept apart.
  void close();

 private:
  void write(std::string_view text);

  Descriptor file_;
  std::uint64_t written_ = 0;
  std::uint64_t left_out_ = 0;
  std::string end_;
};

}  // namespace stillmap::server
