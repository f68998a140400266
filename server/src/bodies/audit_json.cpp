#include "bodies/audit_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {

namespace {

Json record_json(const AuditRecord& record) {
  return {{"id", record.id},
          {"time_ns", std::to_string(record.time_ns)},
          {"request_id", record.request_id},
          {"server_request_id", record.server_request_id},
          {"source", record.source},
          {"key_id", record.key_id},
          {"method", record.method},
          {"route", record.route},
          {"subject", record.subject},
          {"status", record.status},
          {"sha256", record.sha256}};
}

}  // namespace

std::string audit_json(const AuditLog::Page& page) {
  Json json;
  json["records"] = Json::array();
  for (const AuditRecord& record : page.records) json["records"].push_back(record_json(record));
  json["next"] = page.next ? Json(*page.next) : Json();
  return to_text(json);
}

std::string audit_line(const AuditRecord& record, const std::string& before) {
  Json json = record_json(record);
  json["previous_sha256"] = before;
  return to_text(json);
}

std::string audit_check_json(const AuditLog::Check& check) {
  return to_text({{"records", check.records},
                  {"newest_id", check.newest_id},
                  {"newest_sha256", check.newest_sha256},
                  {"first_wrong_id", check.first_wrong_id ? Json(*check.first_wrong_id) : Json()}});
}

}  // namespace stillmap::server
