#include "json/audit_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {

std::string audit_json(const maps::AuditLog::Page& page) {
  Json json;
  json["records"] = Json::array();
  for (const maps::AuditRecord& record : page.records) {
    json["records"].push_back({{"id", record.id},
                               {"time_ns", std::to_string(record.time_ns)},
                               {"request_id", record.request_id},
                               {"server_request_id", record.server_request_id},
                               {"source", record.source},
                               {"key_id", record.key_id},
                               {"method", record.method},
                               {"route", record.route},
                               {"subject", record.subject},
                               {"status", record.status}});
  }
  json["next"] = page.next ? Json(*page.next) : Json();
  return to_text(json);
}

}  // namespace stillmap::server
