#pragma once

#include "pose/pose_answer.hpp"

#include <stillmap/server/server_options.hpp>

#include <string>
#include <vector>

/// Answers as JSON text, keys in a fixed order. `server/reference.md` says what each key means.
namespace stillmap::server {

[[nodiscard]] std::string pose_answer_json(const PoseAnswer& answer);

/// One answer of a batch: a pose (200) or a problem, as JSON.
struct BatchedAnswer {
  int http_status = 200;
  std::string body;
};
[[nodiscard]] std::string batch_answer_json(const std::vector<BatchedAnswer>& answers,
                                            const std::string& request_id);

/// {"status": STATUS, "reasons": [...]}
[[nodiscard]] std::string status_json(const std::string& status,
                                      const std::vector<std::string>& reasons);

struct ServerStatus {
  std::string version;
  std::size_t maps = 0;
  double uptime_s = 0.0;
  int workers = 0;
};
[[nodiscard]] std::string server_status_json(const ServerStatus& status,
                                             const ServerOptions& options);

}  // namespace stillmap::server
