#include "json/localization_options_json.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string_view>

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

std::string names_in(std::string_view group) {
  std::string names;
  for (const localization::OptionInfo& each : localization::all_options()) {
    if (!each.key.starts_with(group)) continue;
    names += names.empty() ? "" : ", ";
    names += each.key.substr(group.size());
  }
  return names;
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
      if (option == nullptr)
        value.refuse(
            fmt::format("no such key; {} has {}", group, names_in(fmt::format("{}.", group))));
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
