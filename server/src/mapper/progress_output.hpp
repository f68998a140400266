#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/mapping/progress_lines.hpp>

#include <CLI/CLI.hpp>

#include <functional>
#include <string>
#include <vector>

namespace stillmap::mapper {

/// How a command shows its progress.
struct ProgressArguments {
  /// `bar` for people, `json` for programs.
  std::string form = "bar";
  /// With `json`: an open file descriptor.
  int fd = 2;
};

void add_progress_options(CLI::App& command, ProgressArguments& arguments);

/// Runs work that goes on later when it is killed, and shows its progress. A signal to cancel ends
/// the program within about a second, in whatever stage.
/// @param plan  for `json`.
/// @throws std::invalid_argument for a descriptor that is not open; what `work` throws, after the
/// last line said so.
void run_with_progress(const ProgressArguments& arguments, std::vector<mapping::StageShare> plan,
                       const std::function<void(const mapping::ProgressCallback&)>& work);

}  // namespace stillmap::mapper
