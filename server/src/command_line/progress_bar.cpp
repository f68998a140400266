#include "progress_bar.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace stillmap::command_line {
namespace {

constexpr std::chrono::milliseconds kRedraw{100};
constexpr std::chrono::seconds kNewLine{5};

}  // namespace

std::string progress_text(std::size_t done, std::size_t total, double elapsed_s) {
  constexpr std::size_t kWidth = 24;
  const double share =
      total == 0 ? 0.0 : std::min(1.0, static_cast<double>(done) / static_cast<double>(total));
  const auto filled = static_cast<std::size_t>(std::floor(share * kWidth));
  std::string text =
      fmt::format("[{}{}] {:3.0f} %  {}/{}", std::string(filled, '#'),
                  std::string(kWidth - filled, '.'), std::floor(100.0 * share), done, total);
  if (share > 0.0 && share < 1.0) {
    text +=
        fmt::format("  {:.0f} s left in this stage", std::ceil(elapsed_s * (1.0 - share) / share));
  }
  return text;
}

ProgressBar::ProgressBar()
    : terminal_(::isatty(STDERR_FILENO) == 1), stage_began_(Clock::now()), shown_(Clock::now()) {}

ProgressBar::~ProgressBar() {
  if (drawn_) fmt::print(stderr, "\r\x1b[K");
}

void ProgressBar::update(std::string_view stage, std::size_t done, std::size_t total,
                         std::string_view detail) {
  const Clock::time_point now = Clock::now();
  if (stage != stage_) {
    stage_ = stage;
    stage_began_ = now;
  }
  const Clock::duration since = now - shown_;
  if (!drawn_ && since < std::chrono::seconds(1)) return;
  if (drawn_ && since < kRedraw && done != total) return;
  if (!terminal_ && since < kNewLine) return;
  shown_ = now;
  const double elapsed_s = std::chrono::duration<double>(now - stage_began_).count();
  std::string text = progress_text(done, total, elapsed_s);
  if (!detail.empty()) text += fmt::format("  {}", detail);
  if (terminal_) {
    fmt::print(stderr, "\r\x1b[K{} {}", stage_, text);
    drawn_ = true;
  } else {
    fmt::print(stderr, "{} {}\n", stage_, text);
  }
  std::fflush(stderr);
}

}  // namespace stillmap::command_line
