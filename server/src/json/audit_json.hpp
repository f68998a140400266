#pragma once

#include <stillmap/maps/store/audit_log.hpp>

#include <string>

namespace stillmap::server {

[[nodiscard]] std::string audit_json(const maps::AuditLog::Page& page);
/// One record on one line, with what is needed to check that it fits to the one before it.
[[nodiscard]] std::string audit_line(const maps::AuditRecord& record, const std::string& before);
[[nodiscard]] std::string audit_check_json(const maps::AuditLog::Check& check);

}  // namespace stillmap::server
