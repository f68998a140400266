#include <stillmap/mapping/map_patch.hpp>

#include <nlohmann/json.hpp>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

/// Calls `visit(key, number)` for each whole number of a result.
template <typename Result, typename Visit>
void for_each_count(Result& result, const Visit& visit) {
  visit("tiles_new", result.tiles_new);
  visit("tiles_kept", result.tiles_kept);
  visit("regions_new", result.regions_new);
  visit("regions_kept", result.regions_kept);
  visit("points_kept", result.points_kept);
  visit("points_replaced", result.points_replaced);
  visit("points_gone", result.points_gone);
  visit("points_added", result.points_added);
  visit("seams", result.seams);
  visit("bytes_new", result.bytes_new);
  visit("bytes", result.bytes);
}

}  // namespace

std::string to_json(const PatchResult& result) {
  Json json;
  json["digest"] = result.digest;
  for_each_count(result, [&](const char* key, std::uint64_t count) { json[key] = count; });
  json["worst_seam_m"] = result.worst_seam_m;
  const Eigen::Vector3d& at = result.worst_seam_at_map;
  json["worst_seam_at_map"] = {at.x(), at.y(), at.z()};
  return json.dump(2);
}

PatchResult patch_result_from(const std::string& text) {
  try {
    const Json json = Json::parse(text);
    PatchResult result;
    result.digest = json.at("digest");
    for_each_count(result, [&](const char* key, std::uint64_t& count) { count = json.at(key); });
    result.worst_seam_m = json.at("worst_seam_m");
    const Json& at = json.at("worst_seam_at_map");
    result.worst_seam_at_map = Eigen::Vector3d(at.at(0), at.at(1), at.at(2));
    return result;
  } catch (const nlohmann::json::exception& error) {
    throw std::invalid_argument(std::string("a patch's result: ") + error.what());
  }
}

}  // namespace stillmap::mapping
