#include "run_program.hpp"

#include <stillmap/maps/drive.hpp>

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <new>
#include <stdexcept>
#include <string>
#include <string_view>

namespace stillmap::command_line {
namespace {

std::atomic<bool> cancelled = false;
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may set it");

std::string called_as = "stillmap";

/// Written before `ends_soon`, which is written before any signal that reads them.
int last_line_fd = -1;
std::string_view last_line;
std::atomic<bool> ends_soon = false;

/// What a program is given to end by itself after a signal [s]: most of the two that are promised.
constexpr unsigned kGraceS = 1;

extern "C" void set_cancelled(int) {
  cancelled = true;
  if (ends_soon) ::alarm(kGraceS);
}

void write_all(int fd, std::string_view text) {
  // Nothing is left to be done about a failure.
  [[maybe_unused]] const ssize_t written = ::write(fd, text.data(), text.size());
}

extern "C" void end_now(int) {
  write_all(STDERR_FILENO, "stillmap: cancelled\n");
  if (last_line_fd >= 0) write_all(last_line_fd, last_line);
  ::_exit(kCancelled);
}

/// By its words: libraries and streams throw what they like, with the system's reason in it.
int code_of(const std::exception& error) {
  const std::string_view words = error.what();
  for (const int full : {ENOSPC, EDQUOT})
    if (words.find(std::strerror(full)) != std::string_view::npos) return kDiskFull;
  return kFailed;
}

int report(std::string message, int exit_code) {
  std::replace(message.begin(), message.end(), '\n', ' ');
  fmt::print(stderr, "stillmap: {}\n", message);
  return exit_code;
}

/// CLI11 would only say that one is required.
void require_known_subcommand(const CLI::App& app, int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  std::string names;
  for (const CLI::App* each : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (each->get_name() == argv[1]) return;
    names += (names.empty() ? "" : ", ") + each->get_name();
  }
  throw std::invalid_argument(fmt::format("found '{}', expected one of {}", argv[1], names));
}

CLI::Validator existing(const char* kind, bool (*holds)(const std::filesystem::path&)) {
  return CLI::Validator(
      [kind, holds](const std::string& path) {
        if (holds(path)) return std::string();
        const bool exists = std::filesystem::exists(path);
        return fmt::format("{}: found {}, expected a {}", path,
                           exists ? "something else" : "nothing", kind);
      },
      kind);
}

}  // namespace

CLI::Validator existing_folder() {
  return existing("folder", [](const std::filesystem::path& path) {
    return std::filesystem::is_directory(path);
  });
}

CLI::Validator folder_or_new() {
  return CLI::Validator(
      [](const std::string& path) {
        const std::filesystem::path folder = std::filesystem::absolute(path).lexically_normal();
        if (std::filesystem::exists(folder))
          return std::filesystem::is_directory(folder)
                     ? std::string()
                     : fmt::format("{}: found something else, expected a folder", path);
        const std::filesystem::path above =
            folder.has_filename() ? folder.parent_path() : folder.parent_path().parent_path();
        if (std::filesystem::is_directory(above)) return std::string();
        return fmt::format("{0}: found nothing, and no folder {1} to make it in; mkdir -p {1}",
                           path, above.string());
      },
      "folder");
}

CLI::Validator existing_file() {
  return existing("file", [](const std::filesystem::path& path) {
    return std::filesystem::is_regular_file(path);
  });
}

CLI::Validator existing_drive() {
  return existing("folder or bag",
                  [](const std::filesystem::path& path) { return maps::Drive::is_at(path); });
}

CLI::Validator existing_path() {
  return existing("file or folder", [](const std::filesystem::path& path) {
    return std::filesystem::exists(path) || maps::Drive::is_at(path);
  });
}

CLI::Validator in_existing_folder() {
  return existing("file in an existing folder", [](const std::filesystem::path& path) {
    return std::filesystem::is_directory(std::filesystem::absolute(path).parent_path()) &&
           !std::filesystem::is_directory(path);
  });
}

int run_program(CLI::App& app, int argc, char** argv) {
  // The mapper may also be called by its own name, which knows fewer commands.
  if (argc > 0 && std::filesystem::path(argv[0]).filename() == called_as) called_as = argv[0];
  try {
    require_known_subcommand(app, argc, argv);
    app.parse(argc, argv);
    return kSucceeded;
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    return report(error.what(), kUsage);
  } catch (const ExitCode& code) {
    return code.value;
  } catch (const std::invalid_argument& error) {
    return report(error.what(), kUsage);
  } catch (const std::bad_alloc&) {
    return report("out of memory", kFailed);
  } catch (const std::exception& error) {
    return cancelled ? report("cancelled", kCancelled) : report(error.what(), code_of(error));
  }
}

const std::string& program_name() { return called_as; }

std::atomic<bool>& cancel_flag() { return cancelled; }

void cancel_on_signals() {
  struct sigaction action {};
  action.sa_handler = set_cancelled;
  action.sa_flags = static_cast<int>(SA_RESTART | SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

void end_soon_when_cancelled(int fd, std::string_view line) {
  last_line_fd = fd;
  last_line = line;
  struct sigaction action {};
  action.sa_handler = end_now;
  sigaction(SIGALRM, &action, nullptr);
  ends_soon = true;
  // A signal that came before was not timed.
  if (cancelled) ::alarm(kGraceS);
}

}  // namespace stillmap::command_line
