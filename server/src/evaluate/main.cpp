#include "command_line/run_program.hpp"
#include "evaluate/commands.hpp"

int main(int argc, char** argv) {
  // People reach this program through `stillmap`, so it goes by that name.
  CLI::App app("The commands of stillmap that measure.", "stillmap");
  app.set_version_flag("--version", STILLMAP_VERSION);
  app.require_subcommand(1);
  CLI::App& evaluate = *app.add_subcommand(
      "evaluate", "Measure localization, a map, odometry or a detector against ground truth");
  evaluate.require_subcommand(1);
  stillmap::evaluate::add_localization(evaluate);
  stillmap::evaluate::add_map(evaluate);
  stillmap::evaluate::add_detector(evaluate);
  stillmap::evaluate::add_odometry(evaluate);
  stillmap::evaluate::add_paper(evaluate);
  stillmap::evaluate::add_paper_odometry(evaluate);
  stillmap::command_line::cancel_on_signals();
  return stillmap::command_line::run_program(app, argc, argv);
}
