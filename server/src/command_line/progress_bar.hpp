#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>

namespace stillmap::command_line {

/// Shows how far long work is, on stderr: one line that is drawn again on a terminal, else a line
/// now and then. What takes less than a second shows nothing.
class ProgressBar {
 public:
  ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  /// Clears its line.
  ~ProgressBar();

  /// @param stage  what is done now.  @param done,total  units of it.
  /// @param detail  shown behind; the estimate of the time left goes on when it changes.
  void update(std::string_view stage, std::size_t done, std::size_t total,
              std::string_view detail = {});

 private:
  using Clock = std::chrono::steady_clock;
  bool terminal_;
  bool drawn_ = false;
  std::string stage_;
  Clock::time_point stage_began_;
  Clock::time_point shown_;
};

/// "BAR  42 %  17/40  12 s left in this stage"; the rest is an estimate from the mean speed so far.
[[nodiscard]] std::string progress_text(std::size_t done, std::size_t total, double elapsed_s);

}  // namespace stillmap::command_line
