#include "bodies/drives_json.hpp"

#include <stillmap/maps/recording_choice.hpp>

#include "json/json_values.hpp"
#include "json/request_json.hpp"

#include "store/map_name.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

const JsonBounds kDriveBounds{.max_bytes = kMostDriveJson, .max_values = 100};

constexpr std::size_t kLongestName = 200;

Json to_json(const DrivePart& part) {
  return {{"n", part.n}, {"sha256", part.sha256}, {"bytes", part.bytes}};
}

Json to_json(const StoredDrive& drive) {
  Json json{{"id", drive.id}, {"map", drive.map}};
  if (drive.is_upload()) {
    json["version"] = drive.target.version;
    json["content_type"] = drive.target.content_type;
  } else {
    json["name"] = drive.name;
  }
  json["status"] = name_of(drive.status);
  json["error"] = drive.error;
  json["bytes"] = drive.bytes;
  json["created_ns"] = std::to_string(drive.created_ns);
  json["finished_ns"] = drive.finished_ns ? Json(std::to_string(*drive.finished_ns)) : Json();
  if (!drive.is_upload())
    json["inspection"] = drive.inspection.empty() ? Json() : Json::parse(drive.inspection);
  return json;
}

std::string text_at(const nlohmann::json& request, const char* key) {
  const auto found = request.find(key);
  return found != request.end() && found->is_string() ? found->get<std::string>() : std::string{};
}

Json list_of(const std::vector<StoredDrive>& drives) {
  Json list = Json::array();
  for (const StoredDrive& drive : drives) list.push_back(to_json(drive));
  return list;
}

bool is_control(char byte) { return static_cast<unsigned char>(byte) < 0x20 || byte == 0x7f; }

}  // namespace

std::string read_drive_json(std::string_view text) {
  if (text.empty()) return {};
  const nlohmann::json request = parse_request_json(text, kDriveBounds);
  require_keys(request, "", {"name"});
  if (!request.contains("name")) return {};
  const nlohmann::json& found = request["name"];
  std::string name = found.is_string() ? found.get<std::string>() : std::string{};
  if (!found.is_string() || name.size() > kLongestName ||
      std::any_of(name.begin(), name.end(), is_control))
    refuse("name", found, "text of at most 200 bytes without control characters");
  return name;
}

std::string read_choice_json(std::string_view text) {
  if (text.empty()) return {};
  const nlohmann::json request = parse_request_json(text, kDriveBounds);
  require_keys(request, "", {"choice"});
  if (!request.contains("choice")) return {};
  const nlohmann::json& found = request["choice"];
  std::string choice = found.is_string() ? found.get<std::string>() : std::string{};
  try {
    if (choice.empty() || std::any_of(choice.begin(), choice.end(), is_control))
      refuse("choice", found, "words as in cloud=/front&poses=/odom, without control characters");
    maps::check_recording_choice(choice, "choice");
  } catch (const maps::InputError& error) {
    const std::string_view why = error.what();
    constexpr std::string_view kExpected = ", expected ";
    refuse("choice", found, std::string(why.substr(why.rfind(kExpected) + kExpected.size())));
  }
  return choice;
}

UploadRequest read_upload_json(std::string_view text) {
  const nlohmann::json request = parse_request_json(text, kDriveBounds);
  require_keys(request, "", {"version", "content_type"});
  UploadRequest result{.version = text_at(request, "version"),
                       .content_type = text_at(request, "content_type")};
  if (!is_valid_map_name(result.version))
    refuse("version", request.value("version", nlohmann::json()), "[a-z0-9][a-z0-9._-]{0,62}");
  if (result.content_type.empty())
    refuse("content_type", request.value("content_type", nlohmann::json()), "a media type");
  return result;
}

std::string part_json(const DrivePart& part) { return to_text(to_json(part)); }

std::string drive_json(const StoredDrive& drive, const std::vector<DrivePart>& parts) {
  Json json = to_json(drive);
  json["parts"] = Json::array();
  for (const DrivePart& part : parts) json["parts"].push_back(to_json(part));
  return to_text(json);
}

std::string upload_json(const StoredDrive& upload, const std::vector<DrivePart>& parts) {
  return drive_json(upload, parts);
}

std::string drive_list_json(const std::vector<StoredDrive>& drives) {
  return to_text(Json{{"drives", list_of(drives)}});
}

std::string upload_list_json(const std::vector<StoredDrive>& uploads) {
  return to_text(Json{{"uploads", list_of(uploads)}});
}

}  // namespace stillmap::server
