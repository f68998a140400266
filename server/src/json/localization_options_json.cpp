#include "json/localization_options_json.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "json/json_values.hpp"

namespace stillmap::server {
namespace {

/// All options with long comments take a tenth of it [bytes].
constexpr std::uintmax_t kMostBytes = std::uintmax_t{64} * 1024;

localization::LocalizationOptions preset_of(const maps::JsonField& root) {
  if (!root.has("preset")) return {};
  const std::string name = root.at("preset").text();
  const auto names = localization::preset_names();
  if (std::ranges::find(names, name) == names.end())
    root.at("preset").refuse(fmt::format("one of {}", fmt::join(names, ", ")));
  return localization::preset(name);
}

/// @param key  `aligner.search_radius_m`.
const localization::OptionInfo* find_localization_option(std::string_view key) {
  const auto options = localization::all_options();
  const auto found = std::ranges::find(options, key, &localization::OptionInfo::key);
  return found == options.end() ? nullptr : &*found;
}

/// For a name that `group` does not have: the nearest one that it has, or all of them.
std::string known_names(const std::string& name, const std::string& group) {
  std::vector<std::string> names;
  for (const localization::OptionInfo& each : localization::all_options())
    if (each.key.starts_with(group)) names.emplace_back(each.key.substr(group.size()));
  const auto nearest = maps::nearest_of(name, names);
  return nearest ? fmt::format("a known key; did you mean {}?", *nearest)
                 : fmt::format("one of the keys {}", fmt::join(names, ", "));
}

}  // namespace

localization::LocalizationOptions read_localization_options(const std::filesystem::path& file) {
  const nlohmann::json json = maps::parse_json(maps::read_text(file, kMostBytes), file.string());
  const maps::JsonField root(json, file.string());
  root.only({"preset", "aligner", "verdict", "tracker"});
  localization::LocalizationOptions options = preset_of(root);
  for (const std::string group : {"aligner", "verdict", "tracker"}) {
    if (!root.has(group)) continue;
    root.at(group).each_member([&](const std::string& name, const maps::JsonField& value) {
      const localization::OptionInfo* option =
          find_localization_option(fmt::format("{}.{}", group, name));
      if (option == nullptr) value.refuse(known_names(name, group + '.'));
      option->set(options, option->whole ? value.whole(static_cast<int>(option->least),
                                                       static_cast<int>(option->most))
                                         : value.number(option->least, option->most));
    });
  }
  return options;
}

localization::LocalizationOptions localization_options_of(const std::filesystem::path& folder,
                                                          const std::string& map) {
  const std::filesystem::path file = folder / (map + ".json");
  if (folder.empty() || !std::filesystem::exists(file)) return {};
  return read_localization_options(file);
}

std::string localization_options_json(const localization::LocalizationOptions& options) {
  Json json;
  for (const localization::OptionInfo& each : localization::all_options()) {
    const std::size_t dot = each.key.find('.');
    Json& group = json[std::string(each.key.substr(0, dot))];
    const double value = each.get(options);
    group[std::string(each.key.substr(dot + 1))] =
        each.whole ? Json(static_cast<int>(value)) : Json(value);
  }
  return to_text(json, 2) + "\n";
}

}  // namespace stillmap::server
