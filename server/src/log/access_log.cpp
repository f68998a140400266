#include "access_log.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>

namespace stillmap::server {
namespace {

thread_local const AccessRecord* current = nullptr;

bool is_probe(std::string_view route) {
  constexpr std::array<std::string_view, 4> kProbes = {"/livez", "/healthz", "/readyz", "/metrics"};
  return std::ranges::find(kProbes, route) != kProbes.end();
}

spdlog::level::level_enum level_of(const AccessRecord& record, bool requests) {
  // A probe that fails while maps load or the server drains is its purpose.
  if (is_probe(record.route)) return spdlog::level::debug;
  if (record.status >= 500) return spdlog::level::warn;
  return requests ? spdlog::level::info : spdlog::level::debug;
}

}  // namespace

void log_access(const AccessRecord& record, bool requests) {
  current = &record;
  spdlog::log(level_of(record, requests), "request");
  current = nullptr;
}

const AccessRecord* current_access_record() { return current; }

}  // namespace stillmap::server
