#pragma once

#include "pose/session.hpp"

#include <memory>
#include <string>
#include <vector>

namespace stillmap::server {

/// One session as clients see it.
[[nodiscard]] std::string session_json(const Session& session, std::chrono::seconds idle_limit);
/// `{"sessions": [...]}`.
[[nodiscard]] std::string session_list_json(const std::vector<std::shared_ptr<Session>>& sessions,
                                            std::chrono::seconds idle_limit);

/// Data of the events `status`, `version_activated` and `closed`.
[[nodiscard]] std::string status_event_json(const localization::TrackedPose& pose);
[[nodiscard]] std::string version_event_json(const std::string& map, const std::string& version);
[[nodiscard]] std::string closed_event_json(const std::string& reason);

}  // namespace stillmap::server
