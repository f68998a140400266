#include <stillmap/mapping/rebuild_gate.hpp>

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

namespace stillmap::mapping {
namespace {

using GateJson = nlohmann::json;

/// A file of a few lines; one that is longer is none.
constexpr std::streamsize kMostBytes = std::streamsize{64} * 1024;

std::string read_some(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::string text(static_cast<std::size_t>(kMostBytes) + 1, '\0');
  stream.read(text.data(), kMostBytes + 1);
  if (stream.bad() || (!stream.eof() && stream.fail()) || stream.gcount() == 0)
    throw maps::InputError(file.string(), "nothing to read", "a JSON object of limits");
  if (stream.gcount() > kMostBytes)
    throw maps::InputError(file.string(), "more than 64 KiB", "a JSON object of limits");
  text.resize(static_cast<std::size_t>(stream.gcount()));
  return text;
}

}  // namespace

GateLimits read_gate_limits(const std::filesystem::path& file) {
  const GateJson json = GateJson::parse(read_some(file), nullptr, false);
  if (!json.is_object())
    throw maps::InputError(file.string(), "something else", "a JSON object of limits");
  GateLimits limits;
  const auto refuse = [&](const std::string& name, const std::string& expected) {
    throw maps::InputError(fmt::format("{} at .{}", file.string(), name),
                           json.at(name).dump(-1, ' ', false, GateJson::error_handler_t::replace),
                           expected);
  };
  const auto number = [&](const std::string& name, double most, double& limit) {
    const std::string expected = fmt::format("a number in [0, {}]", most);
    if (!json.at(name).is_number()) refuse(name, expected);
    limit = json.at(name).get<double>();
    if (!(limit >= 0.0 && limit <= most)) refuse(name, expected);
  };
  const auto share = [&](const std::string& name, double& limit) { number(name, 1.0, limit); };
  const auto count = [&](const std::string& name, std::size_t least, std::size_t& limit) {
    if (!json.at(name).is_number_unsigned() || json.at(name).get<std::size_t>() < least)
      refuse(name, fmt::format("a whole number >= {}", least));
    limit = json.at(name).get<std::size_t>();
  };
  for (const auto& [name, value] : json.items()) {
    if (name == "least_queries") {
      count(name, 1, limits.least_queries);
    } else if (name == "new_lost") {
      count(name, 0, limits.new_lost);
    } else if (name == "least_found_in_keep") {
      share(name, limits.least_found_in_keep);
    } else if (name == "found_below_keep") {
      share(name, limits.found_below_keep);
    } else if (name == "static_loss") {
      share(name, limits.static_loss);
    } else if (name == "driven_coverage") {
      share(name, limits.driven_coverage);
    } else if (name == "ground_coverage") {
      share(name, limits.ground_coverage);
    } else if (name == "first_found") {
      share(name, limits.first_found);
    } else if (name == "wall_thickening") {
      share(name, limits.wall_thickening);
    } else if (name == "entropy_rise") {
      number(name, 10.0, limits.entropy_rise);
    } else {
      refuse(name,
             "one of least_queries, least_found_in_keep, found_below_keep, new_lost, static_loss, "
             "driven_coverage, ground_coverage, wall_thickening, entropy_rise, first_found");
    }
  }
  return limits;
}

}  // namespace stillmap::mapping
