#include "command_line/run_program.hpp"
#include "mapper/commands.hpp"

int main(int argc, char** argv) {
  // People reach this program through `stillmap`, so it goes by that name.
  CLI::App app("The commands of stillmap that make maps.", "stillmap");
  app.set_version_flag("--version", STILLMAP_VERSION);
  app.require_subcommand(1);
  stillmap::mapper::add_build(app);
  stillmap::mapper::add_rebuild(app);
  stillmap::mapper::add_import(app);
  stillmap::mapper::add_export(app);
  stillmap::mapper::add_calibrate(app);
  stillmap::mapper::add_simulate(app);
  stillmap::mapper::add_check_poses(app);
  stillmap::command_line::cancel_on_signals();
  return stillmap::command_line::run_program(app, argc, argv);
}
