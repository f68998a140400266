#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// How far a job is.
struct JobProgress {
  std::string stage{};
  /// In [0, 1], never falls within an attempt.
  double fraction = 0.0;
  /// Nothing until it can be told [s].
  std::optional<double> eta_s{};
};

/// What the mapper's progress lines say (mapping/rebuild.md). Another program's, or none, cost
/// nothing but the progress. For one thread.
class ProgressReader {
 public:
  /// Longer lines are none of the mapper's.
  static constexpr std::size_t kLongestLine = std::size_t{16} << 10U;

  /// Takes the next bytes. @return whether something is new.
  bool append(std::string_view bytes);
  [[nodiscard]] const JobProgress& progress() const { return progress_; }
  /// Why it failed, once it has said so.
  [[nodiscard]] const std::string& failure() const { return failure_; }
  /// Lines that could not be read.
  [[nodiscard]] std::size_t unread() const { return unread_; }

 private:
  bool read_line(std::string_view line);

  std::string line_;
  bool too_long_ = false;
  JobProgress progress_;
  std::string failure_;
  std::size_t unread_ = 0;
};

}  // namespace stillmap::server
