#include "mapper/commands.hpp"

namespace stillmap::mapper {

void add_evaluate(CLI::App& app) {
  CLI::App* evaluate = app.add_subcommand(
      "evaluate", "Measure localization, a map, odometry or a detector against a drive's truth");
  evaluate->require_subcommand(1);
  add_evaluate_localization(*evaluate);
  add_evaluate_map(*evaluate);
  add_evaluate_detector(*evaluate);
  add_evaluate_odometry(*evaluate);
  add_evaluate_paper(*evaluate);
  add_evaluate_paper_odometry(*evaluate);
}

}  // namespace stillmap::mapper
