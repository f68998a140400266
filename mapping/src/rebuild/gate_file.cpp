#include <stillmap/mapping/rebuild_gate.hpp>

#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <cstdint>
#include <limits>

namespace stillmap::mapping {
namespace {

/// A file of a few lines: a longer one is another file [bytes].
constexpr std::uintmax_t kMostBytes = std::uintmax_t{64} * 1024;

}  // namespace

GateLimits read_gate_limits(const std::filesystem::path& file) {
  const nlohmann::json json = maps::parse_json(maps::read_text(file, kMostBytes), file.string());
  const maps::JsonField root(json, file.string());
  root.only({"least_queries", "least_found_in_keep", "found_below_keep", "new_lost", "static_loss",
             "driven_coverage", "ground_coverage", "wall_thickening", "entropy_rise",
             "first_found"});
  GateLimits limits;
  const auto number = [&](const char* name, double most, double& limit) {
    if (root.has(name)) limit = root.at(name).number(0.0, most);
  };
  const auto count = [&](const char* name, std::int64_t least, std::size_t& limit) {
    constexpr auto kMost = std::numeric_limits<std::int64_t>::max();
    if (root.has(name)) limit = static_cast<std::size_t>(root.at(name).integer(least, kMost));
  };
  count("least_queries", 1, limits.least_queries);
  count("new_lost", 0, limits.new_lost);
  number("least_found_in_keep", 1.0, limits.least_found_in_keep);
  number("found_below_keep", 1.0, limits.found_below_keep);
  number("static_loss", 1.0, limits.static_loss);
  number("driven_coverage", 1.0, limits.driven_coverage);
  number("ground_coverage", 1.0, limits.ground_coverage);
  number("first_found", 1.0, limits.first_found);
  number("wall_thickening", 1.0, limits.wall_thickening);
  number("entropy_rise", 10.0, limits.entropy_rise);
  return limits;
}

}  // namespace stillmap::mapping
