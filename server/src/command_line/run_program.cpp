#include "run_program.hpp"

#include <stillmap/maps/drive.hpp>

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "command_line/command_tree.hpp"
#include "command_line/help_text.hpp"
#include "command_line/suggestion.hpp"

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

/// A line for each end, made before any signal that writes it.
struct CancelLines {
  std::string kept;
  std::string if_kept;
  std::string if_not;

  /// For a signal handler too.
  [[nodiscard]] std::string_view line() const {
    return !kept.empty() && ::access(kept.c_str(), F_OK) == 0 ? if_kept : if_not;
  }
};

std::string cancel_line(const std::string& words) {
  return fmt::format("stillmap: cancelled; {}\n", words);
}

CancelLines lines_of(const WhenCancelled& words) {
  return {words.kept.string(), cancel_line(words.if_kept), cancel_line(words.if_not)};
}

/// Set by `cancel_on_signals`, before any signal can need it.
std::atomic<const CancelLines*> cancel_lines = nullptr;

int report_cancelled() {
  const std::string_view line = cancel_lines.load()->line();
  fmt::print(stderr, "{}", line);
  return exit_code::kCancelled;
}

extern "C" void end_now(int) {
  write_all(STDERR_FILENO, cancel_lines.load()->line());
  if (last_line_fd >= 0) write_all(last_line_fd, last_line);
  ::_exit(exit_code::kCancelled);
}

/// By its words: libraries and streams throw what they like, with the system's reason in it.
int code_of(const std::exception& error) {
  const std::string_view words = error.what();
  for (const int full : {ENOSPC, EDQUOT})
    if (words.find(std::strerror(full)) != std::string_view::npos) return exit_code::kDiskFull;
  return exit_code::kFailed;
}

int report(std::string message, int exit_code) {
  std::replace(message.begin(), message.end(), '\n', ' ');
  fmt::print(stderr, "stillmap: {}\n", message);
  return exit_code;
}

/// The command that CLI11 came to.
const CLI::App& parsed_command(const CLI::App& app) {
  const CLI::App* command = &app;
  while (!command->get_subcommands().empty()) command = command->get_subcommands().front();
  return *command;
}

/// CLI11's words, and what to do.
std::string words_of(const CLI::ParseError& error, const CLI::App& app) {
  const CLI::App& command = parsed_command(app);
  const std::string help = full_name(command) + " --help";
  const std::string what = error.what();
  if (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr) {
    if (!listed_commands(command).empty()) {
      std::vector<std::string> names;
      for (const CLI::App* each : listed_commands(command)) names.push_back(each->get_name());
      return fmt::format("{} needs a command: one of {}; see {}", full_name(command),
                         fmt::join(names, ", "), help);
    }
    constexpr std::string_view kEnd = " is required";
    if (what.ends_with(kEnd))
      return fmt::format("{} is missing; see {}", what.substr(0, what.size() - kEnd.size()), help);
  }
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
    const std::string name = what.substr(0, what.find(':'));
    const CLI::Option* const option = command.get_option_no_throw(name);
    if (option != nullptr && option->count() > static_cast<std::size_t>(option->get_expected_max()))
      return fmt::format("too many arguments: {} takes {} at most; see {}", name,
                         option->get_expected_max(), help);
    if (option != nullptr && option->get_expected_min() > 1)
      return fmt::format("{} needs {} values: {}; see {}", name, option->get_expected_min(),
                         option->get_type_name(), help);
    return fmt::format("{} needs a value; see {}", name, help);
  }
  if (dynamic_cast<const CLI::ConversionError*>(&error) != nullptr) {
    constexpr std::string_view kBegin = "Could not convert: ";
    const std::size_t value = what.find(" = ");
    if (what.starts_with(kBegin) && value != std::string::npos)
      return fmt::format("{}: '{}' is not a number; see {}",
                         what.substr(kBegin.size(), value - kBegin.size()), what.substr(value + 3),
                         help);
  }
  if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr)
    return fmt::format("too many arguments: {}; see {}", fmt::join(app.remaining(true), " "), help);
  // Validators of ours have said what to do.
  return dynamic_cast<const CLI::ValidationError*>(&error) != nullptr
             ? what
             : fmt::format("{}; see {}", what, help);
}

/// For users who give the file of `--json` after a space.
std::string hint_of_json(std::span<char* const> words, const std::string& error) {
  for (std::size_t i = 1; i < words.size(); ++i)
    if (words[i - 1] == std::string_view("--json") && error.find(words[i]) != std::string::npos)
      return fmt::format("; to write JSON to {0}, give --json={0}", words[i]);
  return {};
}

/// An error of standard output must not pass unnoticed.
void flush_output() {
  if (std::fflush(stdout) == 0 || errno == EPIPE) return;
  throw std::runtime_error(
      fmt::format("standard output: {}; send it to a disk with free space", std::strerror(errno)));
}

void set_up(CLI::App& app) {
  app.formatter(std::make_shared<HelpText>());
  for (CLI::App* each : app.get_subcommands([](const CLI::App*) { return true; })) set_up(*each);
}

CLI::Validator existing(const char* kind, bool (*holds)(const std::filesystem::path&)) {
  return CLI::Validator(
      [kind, holds](const std::string& path) {
        if (holds(path)) return std::string();
        if (std::filesystem::exists(path))
          return fmt::format("{} is no {}; give a {}", path, kind, kind);
        return fmt::format("{} does not exist; give a {} that does", path, kind);
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
                     : fmt::format("{} is no folder; give a folder, or the name of a new one",
                                   path);
        const std::filesystem::path above =
            folder.has_filename() ? folder.parent_path() : folder.parent_path().parent_path();
        if (std::filesystem::is_directory(above)) return std::string();
        return fmt::format("{0} cannot be made: there is no folder {1}; make it with mkdir -p {1}",
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

CLI::Validator existing_scan_or_drive() {
  return existing("scan file or drive", [](const std::filesystem::path& path) {
    return std::filesystem::is_regular_file(path) || maps::Drive::is_at(path);
  });
}

CLI::Validator existing_path() {
  return existing("file or folder", [](const std::filesystem::path& path) {
    return std::filesystem::exists(path) || maps::Drive::is_at(path);
  });
}

CLI::Validator in_existing_folder() {
  return CLI::Validator(
      [](const std::string& file) {
        if (std::filesystem::is_directory(file))
          return fmt::format("{} is a folder; give the name of a file", file);
        const std::filesystem::path above = std::filesystem::absolute(file).parent_path();
        if (std::filesystem::is_directory(above)) return std::string();
        return fmt::format(
            "{0} cannot be written: there is no folder {1}; make it with mkdir -p {1}", file,
            above.string());
      },
      "file");
}

int run_program(CLI::App& app, int argc, char** argv) {
  // The mapper may also be called by its own name, which knows fewer commands.
  if (argc > 0 && std::filesystem::path(argv[0]).filename() == called_as) called_as = argv[0];
  set_up(app);
  const std::span<char* const> words(argv + std::min(argc, 1), argv + argc);
  try {
    if (words.size() == 1 && words[0] == std::string_view(kPrintsCommandTree)) {
      fmt::print("{}", to_json(command_tree(app)));
    } else {
      require_known_words(app, words);
      app.parse(argc, argv);
    }
    flush_output();
    return exit_code::kSucceeded;
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    const std::string text = words_of(error, app);
    return report(text + hint_of_json(words, text), exit_code::kUsage);
  } catch (const ExitCode& code) {
    return code.value;
  } catch (const std::invalid_argument& error) {
    return report(error.what(), exit_code::kUsage);
  } catch (const std::bad_alloc&) {
    return report("out of memory; give the command more memory, or less work", exit_code::kFailed);
  } catch (const std::exception& error) {
    return cancelled ? report_cancelled() : report(error.what(), code_of(error));
  }
}

const std::string& program_name() { return called_as; }

std::atomic<bool>& cancel_flag() { return cancelled; }

void cancel_on_signals() {
  say_when_cancelled({});
  struct sigaction action {};
  action.sa_handler = set_cancelled;
  action.sa_flags = static_cast<int>(SA_RESTART | SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

void say_when_cancelled(const WhenCancelled& words) {
  // A signal may read the lines before: they stay. Commands call this once or twice.
  static std::vector<std::unique_ptr<const CancelLines>> all;
  cancel_lines = all.emplace_back(std::make_unique<const CancelLines>(lines_of(words))).get();
}

WhenCancelled goes_on_from(const std::filesystem::path& kept) {
  return {.kept = kept,
          .if_kept = fmt::format("finished work is kept in {}; the same command goes on from there",
                                 kept.string())};
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
