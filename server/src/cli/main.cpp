#include <fmt/core.h>

#include <exception>
#include <string>

#include "cli/commands.hpp"
#include "command_line/run_program.hpp"

int main(int argc, char** argv) {
  namespace cli = stillmap::cli;
  if (const char* program = argc > 1 ? cli::offline_program(argv[1]) : nullptr) {
    try {
      cli::exec_offline(program, argv);
    } catch (const std::exception& error) {
      fmt::print(stderr, "stillmap: {}\n", error.what());
      return stillmap::exit_code::kFailed;
    }
  }
  CLI::App app(
      "Turns LiDAR drives into maps that hold only what stays, and answers where a scan was taken.",
      "stillmap");
  app.set_version_flag("--version", STILLMAP_VERSION);
  app.require_subcommand(1);
  cli::add_offline_commands(app);
  cli::add_localize(app);
  cli::add_serve(app);
  cli::add_inspect(app);
  cli::add_delta(app);
  cli::add_mirror(app);
  cli::add_store(app);
  cli::add_keys(app);
  cli::add_audit(app);
  cli::add_completion(app);
  app.footer(std::string(stillmap::command_line::kExitCodes) +
             "\n`stillmap COMMAND --help` says more about a command.");
  return stillmap::command_line::run_program(app, argc, argv);
}
