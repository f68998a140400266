#include "json/problem_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {

std::string problem_json(const ApiError& error, const std::string& request_id) {
  const ErrorInfo& info = info_of(error.code());
  Json json;
  json["type"] = "urn:stillmap:error:" + std::string(info.text);
  json["title"] = info.title;
  json["status"] = info.http_status;
  json["detail"] = error.what();
  json["code"] = info.text;
  json["request_id"] = request_id;
  json["errors"] = Json::array();
  for (const FieldError& each : error.errors()) {
    json["errors"].push_back(
        {{"path", each.path}, {"found", each.found}, {"expected", each.expected}});
  }
  return to_text(json);
}

}  // namespace stillmap::server
