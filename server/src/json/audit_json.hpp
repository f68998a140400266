#pragma once

#include <stillmap/maps/store/audit_log.hpp>

#include <string>

namespace stillmap::server {

[[nodiscard]] std::string audit_json(const maps::AuditLog::Page& page);

}  // namespace stillmap::server
