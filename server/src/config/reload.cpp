#include "reload.hpp"

#include "option_table.hpp"

namespace stillmap::server {

ReloadReport reload(const ConfigSources& sources, OptionsHolder& holder,
                    const std::vector<ReloadPreparation>& others) {
  ReloadReport report;
  ResolvedConfig config = resolve(sources);
  report.problems = std::move(config.problems);
  if (!report.problems.empty()) return report;

  ServerOptions next = *holder.current();
  for (const Option& option : all_options()) {
    const OptionValue value = option.get(config.options);
    if (value == option.get(next)) continue;
    if (option.reloadable && option.set(next, value)) {
      report.changed.emplace_back(option.key);
    } else {
      report.need_restart.emplace_back(option.key);
    }
  }
  // A new value may not go together with an old one that stays.
  for (const BrokenOption& broken : broken_options(next)) {
    report.problems.push_back(
        {"with what needs a restart", broken.key, broken.found, broken.expected});
  }
  if (!report.problems.empty()) {
    report.changed.clear();
    return report;
  }
  std::vector<PreparedReload> prepared;
  for (const ReloadPreparation& prepare : others) prepared.push_back(prepare(next));
  holder.replace(next);
  for (const PreparedReload& put_in_force : prepared) put_in_force();
  return report;
}

}  // namespace stillmap::server
