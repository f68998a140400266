#pragma once

#include <stillmap/localization/tracker.hpp>

#include <string>

namespace stillmap::server {

/// Data of the events `status`, `version_activated` and `closed`.
[[nodiscard]] std::string status_event_json(const localization::TrackedPose& pose);
[[nodiscard]] std::string version_event_json(const std::string& map, const std::string& version);
[[nodiscard]] std::string closed_event_json(const std::string& reason);

}  // namespace stillmap::server
