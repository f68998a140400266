#pragma once

#include "store/audit_log.hpp"

#include <string>

namespace stillmap::server {

[[nodiscard]] std::string audit_json(const AuditLog::Page& page);
/// One record on one line, with what is needed to check that it fits to the one before it.
[[nodiscard]] std::string audit_line(const AuditRecord& record, const std::string& before);
[[nodiscard]] std::string audit_check_json(const AuditLog::Check& check);

}  // namespace stillmap::server
