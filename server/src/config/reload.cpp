#include "reload.hpp"

#include "option_table.hpp"

namespace stillmap::server {

ReloadResult reload(const ConfigSources& sources, OptionsHolder& holder,
                    const std::vector<ReloadPreparation>& others) {
  ReloadResult result;
  ResolvedConfig config = resolve(sources);
  result.problems = std::move(config.problems);
  if (!result.problems.empty()) return result;

  ServerOptions next = *holder.current();
  for (const Option& option : all_options()) {
    const OptionValue value = option.get(config.options);
    if (value == option.get(next)) continue;
    if (option.reloadable && option.set(next, value)) {
      result.changed.emplace_back(option.key);
    } else {
      result.need_restart.emplace_back(option.key);
    }
  }
  // A new value may not go together with an old one that stays.
  for (const BrokenOption& broken : broken_options(next)) {
    result.problems.push_back(
        {"with what needs a restart", broken.key, broken.found, broken.expected});
  }
  if (!result.problems.empty()) {
    result.changed.clear();
    return result;
  }
  std::vector<PreparedReload> prepared;
  for (const ReloadPreparation& prepare : others) prepared.push_back(prepare(next));
  holder.replace(next);
  for (const PreparedReload& put_in_force : prepared) put_in_force();
  return result;
}

}  // namespace stillmap::server
