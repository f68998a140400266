#include "jobs/job_request.hpp"

#include "errors/api_error.hpp"
#include "json/request_json.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>
#include "store/map_name.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

namespace stillmap::server {
namespace {

using RequestJson = nlohmann::json;

const JsonBounds kRebuildBounds{.max_bytes = kMostRebuildJson, .max_values = kMostEditValues};

/// Drives of one rebuild.
constexpr std::size_t kMostDrives = 100;

/// An option of the mapper that a client may give, and the words that it takes.
struct Words {
  std::string_view name;
  std::array<std::string_view, 6> words;
};
// Detectors and methods that need a file of the machine are not among them.
constexpr std::array kWords = {
    Words{"preset", {"default", "paper"}},
    Words{"odometry", {"default", "loam", "given"}},
    Words{"given-poses", {"refine", "exact"}},
    Words{"movable", {"project", "delete", "keep"}},
    Words{"clean", {"free-space", "none", "removert", "erasor", "octomap", "dufomap"}},
    Words{"detector", {"geometric", "voxelnext"}},
    Words{"fusion", {"on", "off"}},
    Words{"fill", {"on", "off"}},
    Words{"loops", {"on", "off"}},
};

/// A number that a client may give.
struct Number {
  std::string_view name, unit;
  double least, most;
};
constexpr std::array kNumbers = {Number{"voxel", "m", 0.02, 2.0},
                                 Number{"sensor-height", "m", 0.1, 10.0},
                                 Number{"pose-time-offset", "s", -1e9, 1e9}};

std::string list_of(const Words& option) {
  std::string text;
  for (const std::string_view word : option.words)
    if (!word.empty()) text += (text.empty() ? "" : ", ") + std::string(word);
  return text;
}

std::string option_names() {
  std::string text = "edits";
  for (const Words& each : kWords) text += ", " + std::string(each.name);
  for (const Number& each : kNumbers) text += ", " + std::string(each.name);
  return text;
}

std::string read_option(const std::string& name, const RequestJson& value) {
  const std::string path = "options." + name;
  for (const Words& option : kWords) {
    if (option.name != name) continue;
    std::string word = value.is_string() ? value.get<std::string>() : std::string{};
    if (word.empty() ||
        std::find(option.words.begin(), option.words.end(), word) == option.words.end())
      refuse(path, value, "one of " + list_of(option));
    return word;
  }
  for (const Number& option : kNumbers) {
    if (option.name != name) continue;
    const double number = value.is_number() ? value.get<double>() : std::nan("");
    if (!(number >= option.least && number <= option.most))
      refuse(path, value, fmt::format("{} to {} [{}]", option.least, option.most, option.unit));
    return fmt::format("{}", number);
  }
  throw field_error(ErrorCode::kUnknownParameter, path, "an unknown option", option_names());
}

/// Null says that there are to be none.
void read_edits(const RequestJson& value, RebuildRequest& request) {
  request.edits_from = RebuildRequest::EditsFrom::kNone;
  if (value.is_null()) return;
  if (!value.is_object()) refuse("options.edits", value, "an object or null");
  request.edits = value.dump();
  request.edits_from = RebuildRequest::EditsFrom::kRequest;
  try {
    static_cast<void>(maps::parse_edits(request.edits, "options.edits"));
  } catch (const maps::InputError& error) {
    throw ApiError(ErrorCode::kInvalidRequest, error.what(),
                   {{"options.edits", "corrections that cannot be read", "an edits file"}});
  }
}

void read_options(const RequestJson& options, RebuildRequest& request) {
  if (!options.is_object()) refuse("options", options, "an object");
  for (const auto& [name, value] : options.items()) {
    if (name == "edits") {
      read_edits(value, request);
    } else {
      request.options[name] = read_option(name, value);
    }
  }
}

std::int64_t read_id(const RequestJson& value, const std::string& path) {
  if (!value.is_number_integer() || value.get<std::int64_t>() < 1)
    refuse(path, value, "the id of a drive");
  return value.get<std::int64_t>();
}

std::vector<std::int64_t> read_drives(const RequestJson& request) {
  const RequestJson drives = request.value("drives", RequestJson());
  if (!drives.is_array() || drives.empty() || drives.size() > kMostDrives)
    refuse("drives", drives, fmt::format("1 to {} ids of drives", kMostDrives));
  std::vector<std::int64_t> ids;
  for (const RequestJson& each : drives) {
    const std::string path = fmt::format("drives[{}]", ids.size());
    ids.push_back(read_id(each, path));
    if (std::count(ids.begin(), ids.end(), ids.back()) > 1) refuse(path, each, "each drive once");
  }
  return ids;
}

bool read_flag(const RequestJson& request, const char* key) {
  const auto found = request.find(key);
  if (found == request.end()) return false;
  if (!found->is_boolean()) refuse(key, *found, "true or false");
  return found->get<bool>();
}

std::string read_version(const RequestJson& request) {
  const auto found = request.find("version");
  if (found == request.end()) return {};
  std::string name = found->is_string() ? found->get<std::string>() : std::string{};
  if (!is_valid_map_name(name)) refuse("version", *found, "[a-z0-9][a-z0-9._-]{0,62}");
  return name;
}

RebuildRequest read_request(const RequestJson& request) {
  require_keys(request, "",
               {"drives", "held_back", "options", "version", "activate", "new_frame", "patch"});
  RebuildRequest result;
  result.edits_from = RebuildRequest::EditsFrom::kSaved;
  result.drives = read_drives(request);
  if (request.contains("held_back")) {
    result.held_back = read_id(request["held_back"], "held_back");
    if (std::count(result.drives.begin(), result.drives.end(), *result.held_back) > 0)
      refuse("held_back", request["held_back"], "a drive that is not in drives");
  }
  if (request.contains("options")) read_options(request["options"], result);
  result.version = read_version(request);
  result.activate = read_flag(request, "activate");
  result.new_frame = read_flag(request, "new_frame");
  result.patch = read_flag(request, "patch");
  if (result.patch && result.new_frame)
    refuse("patch", request["patch"], "false with new_frame: a patch stands in the active version");
  return result;
}

RequestJson as_asked(const RebuildRequest& request) {
  // Keys are sorted, and what was left out stays out: equal requests have equal texts.
  RequestJson result{{"drives", request.drives}};
  if (request.held_back) result["held_back"] = *request.held_back;
  for (const auto& [name, value] : request.options) {
    const bool is_number = std::any_of(kNumbers.begin(), kNumbers.end(),
                                       [&](const Number& each) { return each.name == name; });
    result["options"][name] = is_number ? RequestJson::parse(value) : RequestJson(value);
  }
  if (!request.edits.empty()) result["options"]["edits"] = RequestJson::parse(request.edits);
  if (request.edits_from == RebuildRequest::EditsFrom::kNone)
    result["options"]["edits"] = RequestJson();
  if (!request.version.empty()) result["version"] = request.version;
  if (request.activate) result["activate"] = true;
  if (request.new_frame) result["new_frame"] = true;
  if (request.patch) result["patch"] = true;
  return result;
}

}  // namespace

std::string_view name_of(RebuildRequest::EditsFrom from) {
  switch (from) {
    case RebuildRequest::EditsFrom::kRequest:
      return "request";
    case RebuildRequest::EditsFrom::kSaved:
      return "saved";
    case RebuildRequest::EditsFrom::kNone:
      break;
  }
  return "none";
}

RebuildRequest read_rebuild_request(std::string_view text) {
  return read_request(parse_request_json(text, kRebuildBounds));
}

std::string to_json(const RebuildRequest& request) { return as_asked(request).dump(); }

bool takes_saved_edits(const RebuildRequest& request) {
  const auto is = [&](const char* option, const char* value) {
    const auto found = request.options.find(option);
    return found != request.options.end() && found->second == value;
  };
  const bool fuses = !is("fusion", "off") && (!is("preset", "paper") || is("fusion", "on"));
  return fuses && !request.new_frame;
}

std::string to_stored_json(const RebuildRequest& request) {
  RequestJson result = as_asked(request);
  result["edits_from"] = name_of(request.edits_from);
  return result.dump();
}

RebuildRequest read_stored_rebuild(std::string_view text) {
  RequestJson request = RequestJson::parse(text);
  const std::string from = request.value("edits_from", "");
  request.erase("edits_from");
  RebuildRequest result = read_request(request);
  if (!result.edits.empty() && from == name_of(RebuildRequest::EditsFrom::kSaved)) {
    result.edits_from = RebuildRequest::EditsFrom::kSaved;
  } else if (result.edits.empty()) {
    // As a program wrote it that knew of none saved.
    result.edits_from = RebuildRequest::EditsFrom::kNone;
  }
  return result;
}

ConvertRequest read_convert_request(std::string_view text) {
  const RequestJson request = parse_request_json(text, kRebuildBounds);
  return {.version = request.at("version"),
          .sha256 = request.at("sha256"),
          .format = request.at("format")};
}

std::string to_json(const ConvertRequest& request) {
  return RequestJson{
      {"version", request.version}, {"sha256", request.sha256}, {"format", request.format}}
      .dump();
}

std::string version_of(const StoredJob& job) {
  std::string wanted = job.kind == JobKind::kConvert ? read_convert_request(job.request).version
                                                     : read_stored_rebuild(job.request).version;
  if (!wanted.empty()) return wanted;
  const auto seconds = static_cast<std::time_t>(job.enqueued_ns / 1'000'000'000);
  return fmt::format("{:%Y%m%d}-job{}", fmt::gmtime(seconds), job.id);
}

}  // namespace stillmap::server
