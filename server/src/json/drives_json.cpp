#include "json/drives_json.hpp"

#include "json/json_values.hpp"
#include "json/request_json.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

constexpr std::size_t kLongestName = 200;

Json to_json(const maps::DrivePart& part) {
  return {{"n", part.n}, {"sha256", part.sha256}, {"bytes", part.bytes}};
}

Json to_json(const maps::StoredDrive& drive) {
  return {{"id", drive.id},
          {"map", drive.map},
          {"name", drive.name},
          {"status", maps::name_of(drive.status)},
          {"error", drive.error},
          {"bytes", drive.bytes},
          {"created_ns", std::to_string(drive.created_ns)},
          {"finished_ns", drive.finished_ns ? Json(std::to_string(*drive.finished_ns)) : Json()}};
}

bool is_control(char byte) { return static_cast<unsigned char>(byte) < 0x20 || byte == 0x7f; }

}  // namespace

std::string read_drive_json(std::string_view text) {
  if (text.empty()) return {};
  const nlohmann::json request = parse_request_json(text, kMostDriveJson);
  require_keys(request, "", {"name"});
  if (!request.contains("name")) return {};
  const nlohmann::json& found = request["name"];
  const std::string name = found.is_string() ? found.get<std::string>() : std::string{};
  if (!found.is_string() || name.size() > kLongestName ||
      std::any_of(name.begin(), name.end(), is_control))
    refuse("name", found, "text of at most 200 bytes without control characters");
  return name;
}

std::string part_json(const maps::DrivePart& part) { return to_text(to_json(part)); }

std::string drive_json(const maps::StoredDrive& drive, const std::vector<maps::DrivePart>& parts) {
  Json json = to_json(drive);
  json["parts"] = Json::array();
  for (const maps::DrivePart& part : parts) json["parts"].push_back(to_json(part));
  return to_text(json);
}

std::string drive_list_json(const std::vector<maps::StoredDrive>& drives) {
  Json json;
  json["drives"] = Json::array();
  for (const maps::StoredDrive& drive : drives) json["drives"].push_back(to_json(drive));
  return to_text(json);
}

}  // namespace stillmap::server
