#pragma once

#include <httplib.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

/// Poses and sessions of a stillmap server for C++20, in one header over cpp-httplib (compiled with
/// the flags of its .pc file) and nlohmann-json. SI units; T_a_b takes points from frame b to
/// frame a. The rest of the interface has no vehicle in it: see the Python client.
namespace stillmap::client {

struct Pose {
  std::array<double, 3> position{};
  /// x, y, z, w
  std::array<double, 4> quaternion{0.0, 0.0, 0.0, 1.0};
};

/// T_map_lidar where the search starts, with one standard deviation each.
struct Prior {
  Pose pose{};
  double sigma_m = 1.0;
  double sigma_rad = 0.1;
};

struct PoseAnswer {
  /// `ok`, `degraded` or `lost`.
  std::string status;
  std::vector<std::string> reasons;
  /// T_map_lidar; nothing when lost.
  std::optional<Pose> pose;
  /// 6x6 row by row, tx ty tz [m] rx ry rz [rad], perturbation on the right, in the lidar frame.
  std::optional<std::array<double, 36>> covariance;
  double inlier_ratio = 0.0;
  std::string map_version;
  std::string request_id;
  /// Every key of the answer.
  nlohmann::json json;
};

class Error : public std::runtime_error {
  using std::runtime_error::runtime_error;
};
/// The server could not be reached or went away, also after the retries.
class ConnectionLost : public Error {
  using Error::Error;
};
/// The server refused the request or failed at it (RFC 9457).
class Problem : public Error {
 public:
  Problem(int http_status, std::string stable_code, const std::string& detail,
          std::optional<double> after_s)
      : Error(std::to_string(http_status) + " " + stable_code + ": " + detail),
        status(http_status),
        code(std::move(stable_code)),
        retry_after_s(after_s) {}
  int status;
  std::string code;
  std::optional<double> retry_after_s;
};

/// What the server asks for, else doubling from 0.1 s, at most 30 s; with chance, so that clients
/// do not come at once.
inline std::chrono::duration<double> wait_time(int tries, const Problem* problem) {
  thread_local std::minstd_rand random(std::random_device{}());
  double base_s = 0.1 * std::pow(2.0, std::min(tries - 1, 10));
  if (problem != nullptr && problem->retry_after_s) base_s = *problem->retry_after_s;
  const double chance = std::uniform_real_distribution(1.0, 1.25)(random);
  return std::chrono::duration<double>(std::min(30.0, base_s * chance));
}

/// Whether the same request may do better later.
inline bool is_passing(const Problem& problem) {
  return (problem.status == 429 || problem.status == 503) && problem.code != "Superseded" &&
         problem.code != "MapUnusable";
}

/// One connection to one server: a client a thread.
class Client {
 public:
  /// @param url  such as `http://127.0.0.1:8080`. @param key  when the server has any.
  /// @param retries  of refused requests (429, 503, after Retry-After), and of poses whose
  /// connection was lost.
  explicit Client(const std::string& url, const std::string& key = {},
                  std::chrono::seconds timeout = std::chrono::seconds(30), int retries = 4)
      : http_(url), retries_(retries) {
    if (!http_.is_valid()) throw std::invalid_argument("url: found '" + url + "'");
    // Each kept connection holds a thread of the server, which ends it after 2 s anyway.
    http_.set_keep_alive(false);
    http_.set_tcp_nodelay(true);
    http_.set_connection_timeout(timeout);
    http_.set_read_timeout(timeout);
    http_.set_write_timeout(timeout);
    if (!key.empty()) http_.set_bearer_token_auth(key);
  }

  /// @param points  x y z [m] of each point in the lidar frame, intensity, and its time relative to
  /// the scan's stamp [s], as `layout` has them: xyz, xyzi or xyzit.
  /// @param prior  nothing = anywhere in the map. @throws Problem, ConnectionLost.
  PoseAnswer localize(const std::string& map, std::span<const float> points,
                      const std::optional<Prior>& prior = {}, const std::string& layout = "xyzi") {
    httplib::Params query = {{"layout", layout}};
    if (prior) {
      query.emplace("prior_t", joined(prior->pose.position));
      query.emplace("prior_q", joined(prior->pose.quaternion));
      query.emplace("prior_sigma", joined(std::array{prior->sigma_m, prior->sigma_rad}));
    }
    return read<PoseAnswer>(post_scan("/v1/maps/" + map + "/localize", query, points, true),
                            pose_of);
  }

  /// @return the session's id.
  std::string open_session(const std::string& map, const std::optional<Prior>& prior = {},
                           std::optional<int> retries = {}) {
    nlohmann::json wanted = {{"map", map}};
    if (prior) {
      std::array<double, 36> covariance{};
      for (std::size_t i = 0; i < 6; ++i)
        covariance[7 * i] = std::pow(i < 3 ? prior->sigma_m : prior->sigma_rad, 2);
      wanted["prior"] = {{"position", prior->pose.position},
                         {"quaternion", prior->pose.quaternion},
                         {"covariance", covariance}};
    }
    const std::string body = wanted.dump();
    const auto send = [&] { return http_.Post("/v1/sessions", body, "application/json"); };
    return read<std::string>(call(send, false, retries.value_or(retries_)),
                             [](const nlohmann::json& json) { return json.at("id"); });
  }

  /// The next scan of a session. Not sent again when the connection is lost: it may have counted.
  /// @throws Problem `Superseded` when a newer one, or `initialize`, came meanwhile.
  PoseAnswer track(const std::string& session, std::span<const float> points, std::int64_t stamp_ns,
                   std::optional<int> retries = {}, const std::string& layout = "xyzi") {
    const httplib::Params query = {{"stamp_ns", std::to_string(stamp_ns)}, {"layout", layout}};
    return read<PoseAnswer>(
        post_scan("/v1/sessions/" + session + "/scans", query, points, false, retries), pose_of);
  }

  /// Also when it has ended already, or the server cannot be reached: it expires by itself.
  void close_session(const std::string& session) { http_.Delete("/v1/sessions/" + session); }

 private:
  template <std::size_t kCount>
  static std::string joined(const std::array<double, kCount>& values) {
    std::string text;
    for (const double value : values)
      text += (text.empty() ? "" : ",") + nlohmann::json(value).dump();
    return text;
  }

  /// What another program has answered, such as a proxy, is a Problem as well.
  template <typename Value, typename Read>
  static Value read(const nlohmann::json& json, const Read& read_value) {
    try {
      return read_value(json);
    } catch (const nlohmann::json::exception& error) {
      throw Problem(200, "", std::string("found another answer than expected: ") + error.what(),
                    std::nullopt);
    }
  }

  static PoseAnswer pose_of(const nlohmann::json& json) {
    PoseAnswer answer;
    answer.status = json.at("status");
    answer.reasons = json.at("reasons");
    if (const auto& pose = json.at("pose"); !pose.is_null())
      answer.pose = Pose{pose.at("position"), pose.at("quaternion")};
    if (const auto& covariance = json.at("covariance"); !covariance.is_null())
      answer.covariance = covariance.get<std::array<double, 36>>();
    answer.inlier_ratio = json.at("inlier_ratio");
    answer.map_version = json.at("map").at("version");
    answer.request_id = json.at("request_id");
    answer.json = json;
    return answer;
  }

  nlohmann::json post_scan(const std::string& path, const httplib::Params& query,
                           std::span<const float> points, bool again,
                           std::optional<int> retries = {}) {
    // The server reads little-endian floats, as every machine that has a lidar writes them.
    const auto* const bytes = reinterpret_cast<const char*>(points.data());
    const std::string target = httplib::append_query_params(path, query);
    const auto send = [&] {
      return http_.Post(target, bytes, points.size_bytes(), "application/octet-stream");
    };
    return call(send, again, retries.value_or(retries_));
  }

  /// @param again  whether it may be sent again after a lost connection.
  template <typename Send>
  nlohmann::json call(const Send& send, bool again, int retries) {
    for (int tries = 1;; ++tries) {
      const httplib::Result result = send();
      std::optional<Problem> problem;
      if (result) {
        // Redirections are not followed.
        if (result->status >= 200 && result->status < 300) return json_of(*result);
        problem = problem_of(*result);
        if (tries > retries || !is_passing(*problem)) throw *problem;
      } else if (tries > retries || !(again || result.error() == httplib::Error::Connection)) {
        throw ConnectionLost("no answer: " + httplib::to_string(result.error()));
      }
      std::this_thread::sleep_for(wait_time(tries, problem ? &*problem : nullptr));
    }
  }

  static nlohmann::json json_of(const httplib::Response& response) {
    nlohmann::json body = nlohmann::json::parse(response.body, nullptr, false);
    if (body.is_discarded())
      throw Problem(response.status, "", found(response, "application/json"), std::nullopt);
    return body;
  }

  static std::string found(const httplib::Response& response, const std::string& expected) {
    const std::string leads = response.get_header_value("Location");
    return "found '" + response.get_header_value("Content-Type") + "'" +
           (leads.empty() ? "" : " that leads to " + leads) + ", expected " + expected;
  }

  static Problem problem_of(const httplib::Response& response) {
    const nlohmann::json body = nlohmann::json::parse(response.body, nullptr, false);
    const auto text = [&](const char* key, const std::string& otherwise) {
      const bool known = body.is_object() && body.contains(key) && body.at(key).is_string();
      return known ? body.at(key).get<std::string>() : otherwise;
    };
    std::optional<double> after_s;
    if (response.has_header("Retry-After"))
      after_s = std::strtod(response.get_header_value("Retry-After").c_str(), nullptr);
    return {response.status, text("code", ""),
            text("detail", found(response, "application/problem+json")), after_s};
  }

  httplib::Client http_;
  int retries_;
};

/// Feeds a session from a sensor that does not wait: `put` never blocks, one thread sends, and of
/// the scans that come while it does only the newest is kept. After a refusal or a lost connection
/// it goes on with the newest; a session that is gone is opened again and searched for everywhere.
class SessionStream {
 public:
  struct Scan {
    std::int64_t stamp_ns = 0;
    std::vector<float> points;
    /// What each point has, a float a letter: xyz, xyzi or xyzit.
    std::string layout = "xyzi";
  };
  struct Counts {
    std::uint64_t answered = 0;
    std::uint64_t superseded = 0;
    std::uint64_t failed = 0;
    std::uint64_t sessions = 0;
  };
  using OnAnswer = std::function<void(std::int64_t stamp_ns, const PoseAnswer&)>;
  using OnError = std::function<void(std::int64_t stamp_ns, const Error&)>;

  /// @param on_answer  told in the sending thread, as `on_error` is; neither may throw.
  /// @param on_error  told of each scan without a pose, whatever the reason.
  SessionStream(Client client, std::string map, OnAnswer on_answer, OnError on_error,
                std::optional<Prior> prior = {})
      : client_(std::move(client)),
        map_(std::move(map)),
        on_answer_(std::move(on_answer)),
        on_error_(std::move(on_error)),
        prior_(std::move(prior)),
        thread_([this](const std::stop_token& stop) { work(stop); }) {}
  SessionStream(const SessionStream&) = delete;
  SessionStream& operator=(const SessionStream&) = delete;
  /// Drops what waits, waits for what is under way, ends the session.
  ~SessionStream() = default;

  /// Takes the place of a scan that waits. @throws std::invalid_argument for what is no scan.
  void put(Scan scan) {
    if (scan.layout.empty() || scan.points.size() % scan.layout.size() != 0)
      throw std::invalid_argument("scan: found " + std::to_string(scan.points.size()) +
                                  " floats, expected a multiple of those of layout '" +
                                  scan.layout + "'");
    {
      const std::scoped_lock lock(mutex_);
      counts_.superseded += waiting_ ? 1 : 0;
      waiting_ = std::move(scan);
    }
    changed_.notify_all();
  }

  /// Waits until nothing waits or is under way. @return whether that came in time.
  bool drain(std::chrono::milliseconds most) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, most, [this] { return !waiting_ && !busy_; });
  }

  [[nodiscard]] Counts counts() const {
    const std::scoped_lock lock(mutex_);
    return counts_;
  }

 private:
  void work(const std::stop_token& stop) {
    int tries = 0;
    std::unique_lock lock(mutex_);
    while (changed_.wait(lock, stop, [this] { return waiting_.has_value(); })) {
      if (stop.stop_requested()) break;
      Scan scan = std::move(*waiting_);
      waiting_.reset();
      busy_ = true;
      lock.unlock();
      const auto pause = send(scan, tries);
      lock.lock();
      tries = pause ? tries + 1 : 0;
      if (pause) {
        changed_.wait_for(lock, stop, *pause, [] { return false; });
        if (!waiting_) waiting_ = std::move(scan);
      }
      busy_ = false;
      changed_.notify_all();
    }
    lock.unlock();
    if (!session_.empty()) client_.close_session(session_);
  }

  /// @return how long to wait before the newest scan is tried; nothing when this one is done with.
  std::optional<std::chrono::duration<double>> send(const Scan& scan, int tries) {
    PoseAnswer answer;
    try {
      if (session_.empty()) open();
      answer = client_.track(session_, scan.points, scan.stamp_ns, 0, scan.layout);
    } catch (const Problem& problem) {
      const bool gone = problem.code == "UnknownSession";
      if (gone) session_.clear();
      failed(scan, problem);
      return gone || is_passing(problem) ? std::optional(wait_time(tries + 1, &problem))
                                         : std::nullopt;
    } catch (const Error& error) {
      failed(scan, error);
      return wait_time(tries + 1, nullptr);
    } catch (const std::exception& error) {
      // Whatever comes, the thread must be there for the next scan.
      failed(scan, Error(error.what()));
      return std::nullopt;
    }
    count(&Counts::answered);
    on_answer_(scan.stamp_ns, answer);
    return std::nullopt;
  }

  void open() {
    // Not tried again here: meanwhile a newer scan may have come, and the stream may have ended.
    session_ = client_.open_session(map_, prior_, 0);
    prior_.reset();  // where it was at first says nothing of a later session
    count(&Counts::sessions);
  }
  void failed(const Scan& scan, const Error& error) {
    count(&Counts::failed);
    on_error_(scan.stamp_ns, error);
  }
  void count(std::uint64_t Counts::*which) {
    const std::scoped_lock lock(mutex_);
    ++(counts_.*which);
  }

  Client client_;
  std::string map_;
  OnAnswer on_answer_;
  OnError on_error_;
  std::optional<Prior> prior_;
  std::string session_;  // of the sending thread
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::optional<Scan> waiting_;
  bool busy_ = false;
  Counts counts_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace stillmap::client
