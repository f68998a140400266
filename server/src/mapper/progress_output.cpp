#include "mapper/progress_output.hpp"

#include <fcntl.h>
#include <fmt/core.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <exception>
#include <new>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "command_line/option_value.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"

namespace stillmap::mapper {
namespace {

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Who does not read gets fewer lines; the work never waits for him.
void write_if_there_is_room(int fd, std::string_view line) {
  pollfd room{fd, POLLOUT, 0};
  if (::poll(&room, 1, 0) != 1 || (room.revents & POLLOUT) == 0) return;
  // Shorter than PIPE_BUF, so a pipe takes it whole.
  while (::write(fd, line.data(), line.size()) < 0 && errno == EINTR) {
  }
}

/// A rebuild makes two maps; "keep" alone does not say which.
std::string stage_words(std::string_view stage) {
  constexpr std::string_view kKeep = "keep: ";
  const bool is_of_keep = stage.starts_with(kKeep);
  return is_of_keep ? fmt::format("map to compare with: {}", stage.substr(kKeep.size()))
                    : std::string(stage);
}

void run_with_lines(int fd, std::vector<mapping::StageShare> plan,
                    const std::function<void(const mapping::ProgressCallback&)>& work) {
  if (::fcntl(fd, F_GETFD) < 0)
    throw std::invalid_argument(fmt::format(
        "--progress-fd: {} is not open; give the number of an open file descriptor", fd));
  // A reader that is gone is no reason to end.
  std::signal(SIGPIPE, SIG_IGN);
  command_line::end_soon_when_cancelled(fd, mapping::cancelled_line());
  mapping::ProgressLines lines(
      std::move(plan), [fd](std::string_view line) { write_if_there_is_room(fd, line); }, now_s);
  try {
    work([&lines](std::string_view stage, std::size_t done, std::size_t total) {
      lines.update(stage, done, total);
    });
  } catch (const std::bad_alloc&) {
    lines.finish("failed", "out of memory");
    throw;
  } catch (const std::exception& error) {
    const bool cancelled = command_line::cancel_flag();
    lines.finish(cancelled ? "cancelled" : "failed", cancelled ? "cancelled" : error.what());
    throw;
  }
  lines.finish("succeeded", "done");
}

}  // namespace

void add_progress_options(CLI::App& command, ProgressArguments& arguments) {
  command
      .add_option("--progress", arguments.form,
                  "How progress is shown: bar, or json (for programs: one object a line)")
      ->capture_default_str()
      ->check(command_line::one_of({"bar", "json"}));
  command
      .add_option("--progress-fd", arguments.fd, "File descriptor that --progress json writes to")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
}

void run_with_progress(const ProgressArguments& arguments, std::vector<mapping::StageShare> plan,
                       const std::function<void(const mapping::ProgressCallback&)>& work) {
  if (arguments.form == "json") return run_with_lines(arguments.fd, std::move(plan), work);
  command_line::end_soon_when_cancelled(-1, {});
  command_line::ProgressBar bar;
  work([&bar](std::string_view stage, std::size_t done, std::size_t total) {
    bar.update(stage_words(stage), done, total);
  });
}

}  // namespace stillmap::mapper
