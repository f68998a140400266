#pragma once

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include <stillmap/maps/map_package.hpp>
#include "support/scripted_http_server.hpp"

namespace stillmap::test {

/// A server of S3 with one bucket, `maps`, in memory. Believes every signature. Compares bodies
/// with their digests, as S3 does. Tests read and change `objects` under `mutex`.
class MemoryS3 {
 public:
  using Answer = ScriptedHttpServer::Answer;
  using Asked = ScriptedHttpServer::Asked;

  [[nodiscard]] std::string url() const { return server_.url(); }
  /// From now on every request is answered 503, or again not.
  void set_away(bool away) { away_ = away; }
  [[nodiscard]] std::vector<std::string> asked(const std::string& method) const {
    std::vector<std::string> targets;
    for (const Asked& each : server_.asked())
      if (each.method == method) targets.push_back(each.target);
    return targets;
  }
  [[nodiscard]] std::set<std::string> keys() {
    const std::scoped_lock lock(mutex);
    std::set<std::string> keys;
    for (const auto& [key, bytes] : objects) keys.insert(key);
    return keys;
  }

  std::mutex mutex;
  std::map<std::string, std::string> objects;
  /// Of every object, as a listing says it.
  std::string modified = "2026-01-01T00:00:00.000Z";

 private:
  static Answer error(int status, const std::string& code) {
    return {.status = status, .body = "<Error><Code>" + code + "</Code></Error>"};
  }
  Answer listing(const std::string& target) {
    // The last parameter in order of names.
    const std::size_t at = target.find("prefix=");
    std::string prefix = target.substr(at + 7);
    for (std::size_t slash; (slash = prefix.find("%2F")) != std::string::npos;)
      prefix.replace(slash, 3, "/");
    std::string body = "<ListBucketResult><IsTruncated>false</IsTruncated>";
    for (const auto& [key, bytes] : objects)
      if (key.starts_with(prefix))
        body += "<Contents><Key>" + key + "</Key><LastModified>" + modified +
                "</LastModified><Size>" + std::to_string(bytes.size()) + "</Size></Contents>";
    return {.body = body + "</ListBucketResult>"};
  }
  Answer answer(const Asked& asked) {
    if (away_) return error(503, "ServiceUnavailable");
    const std::scoped_lock lock(mutex);
    if (asked.target.starts_with("/maps?")) return listing(asked.target);
    const std::string key = asked.target.substr(std::string("/maps/").size());
    if (asked.method == "PUT") {
      if (maps::sha256_of(asked.body) != asked.headers.at("x-amz-content-sha256"))
        return error(400, "XAmzContentSHA256Mismatch");
      objects[key] = asked.body;
      return {};
    }
    const auto found = objects.find(key);
    if (asked.method == "DELETE") {
      if (found != objects.end()) objects.erase(found);
      return {.status = 204};
    }
    const bool is_head = asked.method == "HEAD";
    if (found == objects.end())
      return is_head ? Answer{.status = 404, .headers = {"Content-Length: 0"}, .has_body = false}
                     : error(404, "NoSuchKey");
    if (is_head)
      return {.headers = {"Content-Length: " + std::to_string(found->second.size())},
              .has_body = false};
    return {.body = found->second};
  }

  std::atomic<bool> away_ = false;
  ScriptedHttpServer server_{[this](const Asked& asked) { return answer(asked); }};
};

}  // namespace stillmap::test
