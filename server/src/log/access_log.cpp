#include "access_log.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <atomic>

namespace stillmap::server {
namespace {

thread_local const AccessRecord* current_record = nullptr;
std::atomic<bool> request_lines = true;

bool is_probe(std::string_view route) {
  constexpr std::array<std::string_view, 4> kProbes = {"/livez", "/healthz", "/readyz", "/metrics"};
  return std::ranges::find(kProbes, route) != kProbes.end();
}

spdlog::level::level_enum level_of(const AccessRecord& record) {
  // A probe that fails while maps load or the server drains is its purpose.
  if (is_probe(record.route)) return spdlog::level::debug;
  if (record.status >= 500) return spdlog::level::warn;
  return request_lines ? spdlog::level::info : spdlog::level::debug;
}

}  // namespace

void log_access(const AccessRecord& record) {
  current_record = &record;
  spdlog::log(level_of(record), "request");
  current_record = nullptr;
}

void set_request_lines(bool wanted) { request_lines = wanted; }

const AccessRecord* current_access_record() { return current_record; }

}  // namespace stillmap::server
