#pragma once

#include <stillmap/localization/thin_scan.hpp>

#include <httplib.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

/// Poses, sessions and map packages of a stillmap server for C++17, in one header over cpp-httplib
/// (compiled with the flags of its .pc file) and nlohmann-json. SI units; T_a_b takes points from
/// frame b to frame a. The rest of the interface has no vehicle in it: see the Python client.
namespace stillmap::client {

/// 6x6 row by row, tx ty tz [m] rx ry rz [rad], perturbation on the right, in the lidar frame. Sent
/// ones may have rows and columns of zeros: "not told", as planar odometry has z, roll and pitch.
using Covariance = std::array<double, 36>;

struct Pose {
  std::array<double, 3> position{};
  /// x, y, z, w
  std::array<double, 4> quaternion{0.0, 0.0, 0.0, 1.0};
};

/// T_map_lidar where the search starts, with one standard deviation each, or a covariance instead.
struct Prior {
  Pose pose{};
  double sigma_m = 1.0;
  double sigma_rad = 0.1;
  std::optional<Covariance> covariance{};
};

/// Where a satellite receiver says that the lidar is (WGS 84), with one standard deviation.
struct Gnss {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double sigma_m = 1.0;
  /// Above the ellipsoid.
  std::optional<double> altitude_m{};
};

/// Pose of the lidar at this scan in the lidar frame at the earlier scan `since_ns`, with one
/// standard deviation each, or a covariance instead.
struct Odometry {
  std::int64_t since_ns = 0;
  Pose pose{};
  double sigma_m = 0.1;
  double sigma_rad = 0.01;
  std::optional<Covariance> covariance{};
};

/// An object that a detector found in the scan, in the lidar frame: length, width, height [m], yaw
/// counter-clockwise from +x.
struct MovableBox {
  std::array<double, 3> centre{};
  std::array<double, 3> size{};
  double yaw_rad = 0.0;
};

/// Points of a scan in the lidar frame; does not own them.
struct Points {
  /// x y z [m], intensity, time relative to the scan's stamp [s], as `layout` has them.
  const float* data = nullptr;
  std::size_t floats = 0;
  /// What each point has, a float a letter: xyz, xyzi or xyzit.
  std::string layout = "xyzi";

  Points(const float* first, std::size_t count, std::string each = "xyzi")
      : data(first), floats(count), layout(std::move(each)) {
    if (layout.empty() || floats % layout.size() != 0)
      throw std::invalid_argument("scan: found " + std::to_string(floats) +
                                  " floats, expected a multiple of those of layout '" + layout +
                                  "'");
  }
  // NOLINTNEXTLINE(google-explicit-constructor)
  Points(const std::vector<float>& points, std::string each = "xyzi")
      : Points(points.data(), points.size(), std::move(each)) {}
};

/// What a query may say besides its scan.
struct Query {
  /// Neither prior nor gnss = anywhere in the map; at most one of the two.
  std::optional<Prior> prior{};
  std::optional<Gnss> gnss{};
  /// Mount of the lidar: asks for T_map_base.
  std::optional<Pose> T_base_lidar{};
  std::vector<MovableBox> movable{};
  std::optional<std::int64_t> stamp_ns{};
  /// `default`, `icp` or `point_to_plane`.
  std::string method{};
  /// From the complete request.
  std::optional<std::chrono::milliseconds> deadline{};
  /// Empty = the active one, or that of a roll-out to this vehicle.
  std::string version{};
  /// Label of the vehicle that asks; empty = none is told.
  std::string vehicle{};
  /// Where no map is named: name of the set of maps that the scan is in; empty = the only one, with
  /// gnss all maps with a place on the Earth. The prior is in the frame of the set.
  std::string set{};
};

/// What a session's scan may say besides points and stamp.
struct ScanOptions {
  std::optional<Odometry> odometry{};
  std::optional<Pose> T_base_lidar{};
  std::vector<MovableBox> movable{};
  std::optional<std::chrono::milliseconds> deadline{};
  /// Instead of the client's.
  std::optional<int> retries{};
  /// Of a sealed scan: about where the vehicle is, as `region_of` says it, for a proxy that sends
  /// scans of one region to one server. `SealedSession` and `SessionStream` fill it in.
  std::string region{};
};

/// The square of 500 m in the frame of the map, or of the set, that a place is in, as proxies are
/// told it.
inline std::string region_of(const Pose& pose) {
  constexpr double kEdgeM = 500.0;
  // A pose from who knows where is no number of a square.
  if (!(std::abs(pose.position[0]) < 1e9 && std::abs(pose.position[1]) < 1e9)) return {};
  const auto cell = [](double x) { return std::to_string(std::llround(std::floor(x / kEdgeM))); };
  return cell(pose.position[0]) + "," + cell(pose.position[1]);
}

/// How a session starts.
struct SessionOptions {
  std::optional<Prior> prior{};
  std::optional<Gnss> gnss{};
  /// Empty = the active one.
  std::string version{};
  /// What operators see, and by which roll-outs know the vehicle; empty = made by the server.
  std::string label{};
  /// Instead of the client's.
  std::optional<int> retries{};
  /// Of a `SessionStream`: its sessions are sealed, and go on with any server of the store.
  bool sealed = false;
  /// Where no map is named: the set of maps that the vehicle goes through; empty = the only one.
  std::string set{};
};

/// What the errors of an `ok` pose stay within but for one in a thousand; nothing = no bound.
struct Protection {
  std::optional<double> longitudinal_m{};
  std::optional<double> lateral_m{};
  std::optional<double> vertical_m{};
  std::optional<double> yaw_rad{};
};

struct MapReference {
  std::string name;
  std::string version;
  std::string digest;
};

/// How far a pose is from the prior.
struct Offset {
  double m = 0.0;
  double rad = 0.0;
};

/// `clock_skew`: the stamp is `ahead_s` ahead of the server's clock. Of sealed sessions
/// `seal_replayed`: the server has gone on from this seal before; `version_activated`: the vehicle
/// would get `version` now. Of sessions in a set `handed_over`: until this scan the vehicle was
/// followed in the map `from_map`.
struct Warning {
  std::string code;
  double ahead_s = 0.0;
  std::string version;
  std::string from_map;
};

struct Timing {
  double wait_ms = 0.0;
  double decode_ms = 0.0;
  double align_ms = 0.0;
  double total_ms = 0.0;
};

struct PoseAnswer {
  /// `ok`, `degraded` or `lost`.
  std::string status;
  std::vector<std::string> reasons;
  /// T_map_lidar; nothing when lost.
  std::optional<Pose> pose;
  /// Nothing when lost, or when no T_base_lidar was sent.
  std::optional<Pose> T_map_base;
  std::optional<Covariance> covariance;
  std::vector<std::string> covariance_order;
  Protection protection;
  double inlier_ratio = 0.0;
  double rmse_m = 0.0;
  std::int64_t movable_points = 0;
  /// Points of the scan that say that nothing came back.
  std::int64_t no_returns = 0;
  /// In the covariance's order; the last three are metres that a turn moves a point 15 m away.
  std::vector<std::array<double, 6>> degenerate_directions;
  std::optional<Offset> prior_to_pose;
  std::int64_t iterations = 0;
  MapReference map;
  std::optional<std::int64_t> stamp_ns;
  Timing timing;
  std::vector<Warning> warnings;
  std::string request_id;
  /// Both of a session's scan only.
  std::string session;
  std::string searched_from;
  /// In a set of maps only: its name, and the pose in its frame, nothing when lost.
  std::string set;
  std::optional<Pose> T_set_lidar;
  /// Every key of the answer.
  nlohmann::json json;
};

/// A pose on the Earth as OGC GeoPose 1.0 has it: of the base if T_base_lidar was sent, else of the
/// lidar.
struct GeoPose {
  /// `ok` or `degraded`: GeoPose itself has no word for it.
  std::string status;
  std::vector<std::string> reasons;
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  /// Above the ellipsoid.
  double height_m = 0.0;
  /// x, y, z, w: takes the vehicle's axes to east, north and up at the vehicle.
  std::array<double, 4> quaternion{};
  /// The scan's stamp.
  std::optional<std::int64_t> valid_time_ms;
};

/// How a session stands. The pose is that of the newest scan that was not lost, at `pose_stamp_ns`.
struct SessionInfo {
  /// Empty for a session of another key.
  std::string id;
  std::string label;
  MapReference map;
  std::string active_version;
  std::int64_t scans = 0;
  /// Empty before the first scan.
  std::string status;
  std::vector<std::string> reasons;
  std::optional<std::int64_t> stamp_ns;
  std::optional<Pose> pose;
  std::optional<std::int64_t> pose_stamp_ns;
  std::optional<Covariance> covariance;
  std::vector<std::string> covariance_order;
  std::optional<double> inlier_ratio;
  double idle_s = 0.0;
  double idle_limit_s = 0.0;
  /// In lists of sessions.
  std::string key_id;
  std::string key_name;
  /// The set that its map is of; empty without one.
  std::string set;
};

/// A point of a map's tile, 20 bytes on the wire.
struct TilePoint {
  /// Relative to the tile's corner [m].
  std::array<float, 3> position{};
  /// In the sensor's own scale.
  float intensity = 0.0F;
  /// Merged into the point, at most 65,535.
  std::uint16_t observations = 0;
  /// 0 measured, 1 measured ground, 2 projected from an object, 3 filled ground.
  std::uint8_t kind = 0;
  /// That a projected point came from: its index among the objects plus 1, modulo 255; 0 = none.
  std::uint8_t object = 0;

  [[nodiscard]] bool is_ground() const { return kind == 1 || kind == 3; }
};

/// What to fetch and to drop so that the tiles around a place are there.
struct TileChange {
  struct Tile {
    /// version/level/x/y
    std::string id;
    std::int64_t points = 0;
    /// Added to the positions of its points it gives the map frame [m].
    std::array<double, 3> corner{};
    /// For `Client::tile`.
    std::string url;
  };
  std::string version;
  std::vector<Tile> add;
  /// Their ids.
  std::vector<std::string> remove;
};

/// A server-sent event: `status`, `version_activated`, `closed`, `gap`.
struct Event {
  /// Nothing for those that are not kept (`gap`).
  std::optional<std::int64_t> id;
  std::string type;
  nlohmann::json data;
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

/// Whether a seal is of no more use: the next scan begins a session without it.
inline bool is_seal_spent(const Problem& problem) {
  return problem.code == "InvalidSeal" || problem.code == "SealExpired" ||
         problem.code == "SealedVersionGone";
}

/// Whether the same request may do better later.
inline bool is_passing(const Problem& problem) {
  return (problem.status == 429 || problem.status == 503) && problem.code != "Superseded" &&
         problem.code != "MapUnusable";
}

/// Requests and answers as JSON; not for callers.
namespace detail {

using Json = nlohmann::json;

inline Covariance covariance_of(double sigma_m, double sigma_rad,
                                const std::optional<Covariance>& covariance) {
  if (covariance) return *covariance;
  Covariance diagonal{};
  for (std::size_t i = 0; i < 6; ++i) diagonal[7 * i] = std::pow(i < 3 ? sigma_m : sigma_rad, 2);
  return diagonal;
}

inline Json to_json(const Pose& pose) {
  return {{"position", pose.position}, {"quaternion", pose.quaternion}};
}

inline Json to_json(const Prior& prior) {
  Json json = to_json(prior.pose);
  json["covariance"] = covariance_of(prior.sigma_m, prior.sigma_rad, prior.covariance);
  return json;
}

inline Json to_json(const Gnss& gnss) {
  Json json = {{"latitude_deg", gnss.latitude_deg},
               {"longitude_deg", gnss.longitude_deg},
               {"sigma_m", gnss.sigma_m}};
  if (gnss.altitude_m) json["altitude_m"] = *gnss.altitude_m;
  return json;
}

inline Json to_json(const Odometry& step) {
  Json json = to_json(step.pose);
  json["since_ns"] = std::to_string(step.since_ns);
  json["covariance"] = covariance_of(step.sigma_m, step.sigma_rad, step.covariance);
  return json;
}

inline Json to_json(const std::vector<MovableBox>& boxes) {
  Json json = Json::array();
  for (const MovableBox& box : boxes)
    json.push_back({{"centre", box.centre}, {"size", box.size}, {"yaw", box.yaw_rad}});
  return json;
}

/// Without the deadline, which a batch has for all.
inline Json to_json(const Query& query) {
  Json json = Json::object();
  if (query.prior) json["prior"] = to_json(*query.prior);
  if (query.gnss) json["gnss"] = to_json(*query.gnss);
  if (query.T_base_lidar) json["T_base_lidar"] = to_json(*query.T_base_lidar);
  if (!query.movable.empty()) json["movable"] = to_json(query.movable);
  if (query.stamp_ns) json["stamp_ns"] = std::to_string(*query.stamp_ns);
  if (!query.method.empty()) json["method"] = query.method;
  return json;
}

inline Json to_json(const ScanOptions& options, std::int64_t stamp_ns) {
  Json json = {{"stamp_ns", std::to_string(stamp_ns)}};
  if (options.odometry) json["odometry"] = to_json(*options.odometry);
  if (options.T_base_lidar) json["T_base_lidar"] = to_json(*options.T_base_lidar);
  if (!options.movable.empty()) json["movable"] = to_json(options.movable);
  if (options.deadline) json["deadline_ms"] = options.deadline->count();
  return json;
}

template <typename Value>
std::optional<Value> optional_of(const Json& json) {
  return json.is_null() ? std::nullopt : std::optional<Value>(json.get<Value>());
}

inline Pose pose_of(const Json& json) {
  return {json.at("position").get<std::array<double, 3>>(),
          json.at("quaternion").get<std::array<double, 4>>()};
}

inline std::optional<Pose> optional_pose_of(const Json& json) {
  return json.is_null() ? std::nullopt : std::optional<Pose>(pose_of(json));
}

/// Nanoseconds are decimal text, since a JSON number is not exact beyond 2^53.
inline std::optional<std::int64_t> stamp_of(const Json& json) {
  if (json.is_null()) return std::nullopt;
  return std::strtoll(json.get_ref<const std::string&>().c_str(), nullptr, 10);
}

inline MapReference map_of(const Json& json) {
  return {json.at("name"), json.at("version"), json.at("digest")};
}

inline std::string text_or_empty(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found == json.end() || found->is_null() ? std::string() : found->get<std::string>();
}

inline PoseAnswer answer_of(const Json& json) {
  PoseAnswer answer;
  answer.status = json.at("status");
  answer.reasons = json.at("reasons").get<std::vector<std::string>>();
  answer.pose = optional_pose_of(json.at("pose"));
  if (const auto base = json.find("T_map_base"); base != json.end())
    answer.T_map_base = optional_pose_of(*base);
  answer.covariance = optional_of<Covariance>(json.at("covariance"));
  answer.covariance_order = json.at("covariance_order").get<std::vector<std::string>>();
  const Json& bounds = json.at("protection");
  answer.protection = {
      optional_of<double>(bounds.at("longitudinal_m")), optional_of<double>(bounds.at("lateral_m")),
      optional_of<double>(bounds.at("vertical_m")), optional_of<double>(bounds.at("yaw_rad"))};
  answer.inlier_ratio = json.at("inlier_ratio");
  answer.rmse_m = json.at("rmse_m");
  answer.movable_points = json.at("movable_points");
  answer.no_returns = json.at("no_returns");
  answer.degenerate_directions =
      json.at("degenerate_directions").get<std::vector<std::array<double, 6>>>();
  if (const Json& offset = json.at("prior_to_pose"); !offset.is_null())
    answer.prior_to_pose = Offset{offset.at("m"), offset.at("rad")};
  answer.iterations = json.at("iterations");
  answer.map = map_of(json.at("map"));
  answer.stamp_ns = stamp_of(json.at("stamp_ns"));
  const Json& timing = json.at("timing_ms");
  answer.timing = {timing.at("wait"), timing.at("decode"), timing.at("align"), timing.at("total")};
  for (const Json& each : json.at("warnings"))
    answer.warnings.push_back({each.at("code"), each.value("ahead_s", 0.0),
                               text_or_empty(each, "version"), text_or_empty(each, "from_map")});
  answer.request_id = json.at("request_id");
  answer.session = text_or_empty(json, "session");
  answer.searched_from = text_or_empty(json, "searched_from");
  answer.set = text_or_empty(json, "set");
  if (const auto in_set = json.find("T_set_lidar"); in_set != json.end())
    answer.T_set_lidar = optional_pose_of(*in_set);
  answer.json = json;
  return answer;
}

inline SessionInfo session_of(const Json& json) {
  SessionInfo info;
  info.id = text_or_empty(json, "id");
  info.label = json.at("label");
  info.map = map_of(json.at("map"));
  info.active_version = json.at("active_version");
  info.scans = json.at("scans");
  info.status = text_or_empty(json, "status");
  info.reasons = json.at("reasons").get<std::vector<std::string>>();
  info.stamp_ns = stamp_of(json.at("stamp_ns"));
  info.pose = optional_pose_of(json.at("pose"));
  info.pose_stamp_ns = stamp_of(json.at("pose_stamp_ns"));
  info.covariance = optional_of<Covariance>(json.at("covariance"));
  info.covariance_order = json.at("covariance_order").get<std::vector<std::string>>();
  info.inlier_ratio = optional_of<double>(json.at("inlier_ratio"));
  info.idle_s = json.at("idle_s");
  info.idle_limit_s = json.at("idle_limit_s");
  info.key_id = text_or_empty(json, "key_id");
  info.key_name = text_or_empty(json, "key_name");
  info.set = text_or_empty(json, "set");
  return info;
}

/// The number after `name=` in the parameters of a frame.
inline double frame_parameter(const std::string& parameters, const std::string& name) {
  const std::size_t at = ("&" + parameters).find("&" + name + "=");
  if (at == std::string::npos) return std::nan("");
  return std::strtod(parameters.c_str() + at + name.size() + 1, nullptr);
}

/// What Advanced has over Basic-Quaternion is the time.
inline constexpr const char* kGeoPose = "application/geopose+json; version=1.0; profile=advanced";

inline GeoPose geopose_of(const Json& json, const httplib::Response& response) {
  GeoPose pose;
  pose.status = response.get_header_value("Stillmap-Status");
  const std::string reasons = response.get_header_value("Stillmap-Reasons");
  for (std::size_t begin = 0; begin < reasons.size();) {
    const std::size_t end = std::min(reasons.find(", ", begin), reasons.size());
    pose.reasons.push_back(reasons.substr(begin, end - begin));
    begin = end + 2;
  }
  const std::string parameters = json.at("frameSpecification").at("parameters");
  pose.latitude_deg = frame_parameter(parameters, "latitude");
  pose.longitude_deg = frame_parameter(parameters, "longitude");
  pose.height_m = frame_parameter(parameters, "height");
  const Json& q = json.at("quaternion");
  pose.quaternion = {q.at("x"), q.at("y"), q.at("z"), q.at("w")};
  if (json.contains("validTime")) pose.valid_time_ms = json.at("validTime").get<std::int64_t>();
  return pose;
}

/// Lines of an event stream (WHATWG HTML, 9.2.6, as far as this server uses it).
class EventReader {
 public:
  /// @return false once `on_event` did, or a line has no end.
  bool read(const char* data, std::size_t size, const std::function<bool(const Event&)>& on_event) {
    constexpr std::size_t kMostLineBytes = 1U << 20U;
    if (buffer_.size() + data_.size() > kMostLineBytes) return false;
    buffer_.append(data, size);
    std::size_t begin = 0;
    for (std::size_t end; (end = buffer_.find('\n', begin)) != std::string::npos; begin = end + 1) {
      if (!line(buffer_.substr(begin, end - begin), on_event)) return false;
    }
    buffer_.erase(0, begin);
    return true;
  }

 private:
  bool line(std::string text, const std::function<bool(const Event&)>& on_event) {
    if (!text.empty() && text.back() == '\r') text.pop_back();
    if (text.empty()) {
      const bool complete = !data_.empty();
      Event event = std::exchange(event_, {});
      if (!complete) return true;
      event.data = nlohmann::json::parse(std::exchange(data_, {}), nullptr, false);
      return on_event(event);
    }
    const std::size_t colon = std::min(text.find(':'), text.size());
    std::size_t at = std::min(colon + 1, text.size());
    if (at < text.size() && text[at] == ' ') ++at;
    const std::string name = text.substr(0, colon);
    if (name == "id") event_.id = std::strtoll(text.c_str() + at, nullptr, 10);
    if (name == "event") event_.type = text.substr(at);
    if (name == "data") data_ += (data_.empty() ? "" : "\n") + text.substr(at);
    return true;
  }

  std::string buffer_;
  std::string data_;
  Event event_;
};

}  // namespace detail

/// One connection to one server: a client a thread.
class Client {
 public:
  /// @param url  such as `http://127.0.0.1:8080`. @param key  when the server has any.
  /// @param retries  of refused requests (429, 503, after Retry-After), and of poses whose
  /// connection was lost.
  explicit Client(const std::string& url, const std::string& key = {},
                  std::chrono::seconds timeout = std::chrono::seconds(30), int retries = 4)
      : http_(url), timeout_(timeout), retries_(retries) {
    if (!http_.is_valid()) throw std::invalid_argument("url: found '" + url + "'");
    // Each kept connection holds a thread of the server, which ends it after 2 s anyway.
    http_.set_keep_alive(false);
    http_.set_tcp_nodelay(true);
    http_.set_connection_timeout(timeout);
    http_.set_write_timeout(timeout);
    if (!key.empty()) http_.set_bearer_token_auth(key);
  }

  /// Of a scan only what is matched is sent, by default as `ThinProfile::kExact`, which is answered
  /// as the whole scan. With boxes of `movable` or another method the whole scan is sent; so it is
  /// from then on to a server that refuses thinned ones.
  /// @param profile  nothing = whole scans. @param own_vehicle_m  as the server's option.
  void thin_scans(std::optional<localization::ThinProfile> profile,
                  double own_vehicle_m = localization::kOwnVehicleM) {
    thin_profile_ = profile;
    own_vehicle_m_ = own_vehicle_m;
  }

  /// Where a scan was taken; the status is `lost` when that cannot be said.
  /// @param map  empty = the map of a set that the scan is in.
  /// @throws Problem, ConnectionLost.
  PoseAnswer localize(const std::string& map, const Points& points, const Query& query = {}) {
    return read<PoseAnswer>(send_query(map, points, query, nullptr), detail::answer_of);
  }

  /// The same as OGC GeoPose, for maps with a place on the Earth. @throws Problem `NoPose` when the
  /// scan is lost and `NotAcceptable` when the map has no place, ConnectionLost.
  GeoPose localize_geopose(const std::string& map, const Points& points, const Query& query = {}) {
    return read<GeoPose>(send_query(map, points, query, detail::kGeoPose), detail::geopose_of);
  }

  /// A scan of a batch.
  struct BatchItem {
    Points points;
    /// Version and deadline are the batch's.
    Query query{};
  };
  /// What one was answered with: a pose, or why it was refused.
  struct BatchAnswer {
    std::optional<PoseAnswer> answer;
    std::optional<Problem> problem;
  };
  /// Several scans in one request, answered in their order. @param version  empty = the active one.
  /// @param vehicle  label of the vehicle that asks; empty = none is told.
  std::vector<BatchAnswer> localize_batch(const std::string& map,
                                          const std::vector<BatchItem>& items,
                                          const std::string& version = {},
                                          std::optional<std::chrono::milliseconds> deadline = {},
                                          const std::string& vehicle = {}) {
    const auto refused = [](const std::vector<BatchAnswer>& answers) {
      return std::any_of(answers.begin(), answers.end(), [](const BatchAnswer& each) {
        return each.problem && refuses_thin(*each.problem);
      });
    };
    Request request{with_vehicle(place_of(map, version) + "/localize/batch", vehicle), {}};
    request.deadline = deadline;
    if (version.empty()) request.active_of = map;
    std::vector<BatchAnswer> answers = send_batch(request, items);
    if (!thin_profile_ || !refused(answers)) return answers;
    const auto profile = std::exchange(thin_profile_, std::nullopt);
    answers = send_batch(request, items);
    if (refused(answers)) thin_profile_ = profile;
    return answers;
  }

  /// @param map  empty = through the maps of a set. @return the session's id.
  std::string open_session(const std::string& map, const SessionOptions& options = {}) {
    nlohmann::json wanted = place_in(options.prior, options.gnss);
    if (!map.empty()) wanted["map"] = map;
    if (!options.set.empty()) wanted["set"] = options.set;
    if (!options.version.empty()) wanted["version"] = options.version;
    if (!options.label.empty()) wanted["label"] = options.label;
    Request request{
        "/v1/sessions", {wanted.dump(), "application/json"}, nullptr, false, options.retries};
    if (options.version.empty()) request.active_of = map;
    return read<std::string>(
        post(request), [](const nlohmann::json& json) { return json.at("id").get<std::string>(); });
  }

  /// The next scan of a session. Not sent again when the connection is lost: it may have counted.
  /// @throws Problem `Superseded` when a newer one, or `initialize`, came meanwhile.
  PoseAnswer track(const std::string& session, const Points& points, std::int64_t stamp_ns,
                   const ScanOptions& options = {}) {
    return read<PoseAnswer>(send_scan(session, points, stamp_ns, options, nullptr),
                            detail::answer_of);
  }

  /// The same as OGC GeoPose. @throws as `localize_geopose`.
  GeoPose track_geopose(const std::string& session, const Points& points, std::int64_t stamp_ns,
                        const ScanOptions& options = {}) {
    return read<GeoPose>(send_scan(session, points, stamp_ns, options, detail::kGeoPose),
                         detail::geopose_of);
  }

  /// The next scan of a sealed session, of which the server keeps nothing. `SealedSession` looks
  /// after the seal.
  /// @param seal  of the answer before; that of this one comes in its place. Empty = a session
  /// begins. @param start  how it begins.
  /// @throws Problem `InvalidSeal`, `SealExpired`, `SealedVersionGone`: begin anew; `ScanNotNewer`.
  PoseAnswer track_sealed(const std::string& map, std::string& seal, const Points& points,
                          std::int64_t stamp_ns, const ScanOptions& options = {},
                          const SessionOptions& start = {}) {
    return read<PoseAnswer>(send_sealed(map, seal, points, stamp_ns, options, start, nullptr),
                            detail::answer_of);
  }

  /// The same as OGC GeoPose. @throws as `localize_geopose`; with `NoPose` comes a seal as well.
  GeoPose track_sealed_geopose(const std::string& map, std::string& seal, const Points& points,
                               std::int64_t stamp_ns, const ScanOptions& options = {},
                               const SessionOptions& start = {}) {
    return read<GeoPose>(send_sealed(map, seal, points, stamp_ns, options, start, detail::kGeoPose),
                         detail::geopose_of);
  }

  /// Forgets where the vehicle was. Neither prior nor gnss = it may be anywhere.
  /// @param retries  instead of the client's.
  SessionInfo initialize(const std::string& session, const std::optional<Prior>& prior = {},
                         const std::optional<Gnss>& gnss = {}, std::optional<int> retries = {}) {
    return read<SessionInfo>(post({"/v1/sessions/" + session + "/initialize",
                                   {place_in(prior, gnss).dump(), "application/json"},
                                   nullptr,
                                   true,
                                   retries}),
                             detail::session_of);
  }

  SessionInfo session(const std::string& session) {
    return read<SessionInfo>(get("/v1/sessions/" + session), detail::session_of);
  }

  /// Those of the key; of all keys with the scope admin. @param map  empty = of all maps.
  std::vector<SessionInfo> sessions(const std::string& map = {}) {
    httplib::Params query;
    if (!map.empty()) query.emplace("map", map);
    return read<std::vector<SessionInfo>>(get(httplib::append_query_params("/v1/sessions", query)),
                                          [](const nlohmann::json& json) {
                                            std::vector<SessionInfo> all;
                                            for (const nlohmann::json& each : json.at("sessions"))
                                              all.push_back(detail::session_of(each));
                                            return all;
                                          });
  }

  /// Gives each event to `on_event` until it returns false, or the session is closed. Goes on with
  /// the next event after a lost connection. Keeps the client busy: give it one of its own.
  /// @param last_id  go on after this event. @throws Problem, ConnectionLost after the retries.
  void events(const std::string& session, const std::function<bool(const Event&)>& on_event,
              std::optional<std::int64_t> last_id = {}) {
    bool more = true;
    const auto take = [&](const Event& event) {
      // The server stops; another may start.
      if (event.type == "end" && !event.id) return true;
      if (event.id) last_id = event.id;
      more = on_event(event) && event.type != "closed";
      return more;
    };
    // The server sends a comment every 15 s.
    be_patient(std::chrono::seconds(40));
    int tries = 0;
    while (more) {
      httplib::Headers headers = {{"Accept", "text/event-stream"}};
      if (last_id) headers.emplace("Last-Event-ID", std::to_string(*last_id));
      detail::EventReader reader;
      const httplib::Response response = stream("/v1/sessions/" + session + "/events", headers,
                                                [&](const char* data, std::size_t size) {
                                                  tries = 0;
                                                  return reader.read(data, size, take);
                                                });
      if (response.status == 204 || !more) return;
      if (response.status >= 300) {
        const Problem problem = problem_of(response);
        if (++tries > retries_ || !is_passing(problem)) throw problem;
        std::this_thread::sleep_for(wait_time(tries, &problem));
      } else if (++tries > retries_) {
        throw ConnectionLost("events of a session: no connection that holds");
      } else {
        std::this_thread::sleep_for(wait_time(tries, nullptr));
      }
    }
  }

  /// Which tiles of the active version are within `radius_m` of a place (x, y in the map frame),
  /// and are not among `known_ids`, and which of these are not. @param radius_m  at most 50 tile
  /// widths.
  TileChange tiles_around(const std::string& map, const std::array<double, 2>& place,
                          double radius_m, const std::vector<std::string>& known_ids = {}) {
    const nlohmann::json request = {
        {"center", place}, {"radius_m", radius_m}, {"cached_ids", known_ids}};
    const auto change_of = [](const nlohmann::json& json) {
      TileChange change;
      change.version = json.at("version");
      for (const nlohmann::json& each : json.at("add"))
        change.add.push_back({each.at("id"), each.at("points"),
                              each.at("corner").get<std::array<double, 3>>(), each.at("url")});
      change.remove = json.at("remove").get<std::vector<std::string>>();
      return change;
    };
    return read<TileChange>(
        post({place_of(map, {}) + "/tiles/diff", {request.dump(), "application/json"}}), change_of);
  }

  /// Points of a tile. @param url  of `tiles_around`. @throws Problem, ConnectionLost.
  std::vector<TilePoint> tile(const std::string& url) {
    constexpr std::size_t kPointBytes = 20;
    static_assert(sizeof(TilePoint) == kPointBytes, "a tile's points are read as they are");
    const httplib::Response response = get(url);
    if (response.body.size() % kPointBytes != 0)
      throw Problem(response.status, "", found(response, "points of 20 bytes"), std::nullopt);
    std::vector<TilePoint> points(response.body.size() / kPointBytes);
    if (!points.empty()) std::memcpy(points.data(), response.body.data(), response.body.size());
    return points;
  }

  /// Writes a map package's tar to `path`; after a lost connection it goes on where it ended.
  /// @param from  digest of another version of the map, whose files are left out; empty = none.
  /// @return its bytes. @throws Problem, ConnectionLost, Error when the file cannot be written.
  std::uint64_t download_version(const std::string& map, const std::string& version,
                                 const std::string& path, const std::string& from = {}) {
    return download(place_of(map, version) + "/content" + (from.empty() ? "" : "?from=" + from),
                    path);
  }

  /// The same of one file of the package. @param sha256  of it; that of manifest.json is the
  /// version's digest.
  std::uint64_t download_file(const MapReference& map, const std::string& sha256,
                              const std::string& path) {
    return download(place_of(map.name, map.version) + "/files/" + sha256, path);
  }

  /// The version of a map that is active. @param vehicle  label of the vehicle that asks: a
  /// roll-out may have another version for it; empty = none is told. @throws Problem,
  /// ConnectionLost.
  MapReference active(const std::string& map, const std::string& vehicle = {}) {
    return read<MapReference>(get(with_vehicle(place_of(map, {}), vehicle)),
                              [&](const nlohmann::json& json) {
                                return MapReference{map, json.at("version"), json.at("digest")};
                              });
  }

  /// Also when it has ended already, or the server cannot be reached: it expires by itself.
  void close_session(const std::string& session) { http_.Delete("/v1/sessions/" + session); }

 private:
  friend class SealedSession;

  std::uint64_t download(const std::string& url, const std::string& path) {
    const std::string part = path + ".part";
    std::ofstream file;
    std::uint64_t size = 0;
    std::string etag;
    const auto begin = [&](const httplib::Response& begun) {
      etag = begun.get_header_value("ETag");
      if (begun.status == 206) return;
      // All of it: the first time, or because it is another package than before.
      size = 0;
      file.close();
      file.open(part, std::ios::binary | std::ios::trunc);
    };
    const auto take = [&](const char* data, std::size_t count) {
      size += file.write(data, static_cast<std::streamsize>(count)) ? count : 0;
      return file.good();
    };
    be_patient(std::chrono::milliseconds(0));
    for (int tries = 1;; ++tries) {
      // A range is one of the bytes as they are.
      httplib::Headers headers = {{"Accept-Encoding", "identity"}};
      if (size > 0) {
        headers.emplace("Range", "bytes=" + std::to_string(size) + "-");
        headers.emplace("If-Range", etag);
      }
      const std::uint64_t before = size;
      const httplib::Response response = stream(url, headers, take, begin);
      if (!file) throw Error(part + ": cannot be written: look at the folder and the disk's room");
      if (response.status == 200 || response.status == 206) break;
      if (size > before) tries = 1;
      std::optional<Problem> problem;
      if (response.status > 0) problem = problem_of(response);
      if (problem && (tries > retries_ || !is_passing(*problem))) throw *problem;
      if (tries > retries_) throw ConnectionLost("download of " + url);
      std::this_thread::sleep_for(wait_time(tries, problem ? &*problem : nullptr));
    }
    file.close();
    if (!file || std::rename(part.c_str(), path.c_str()) != 0)
      throw Error(path + ": cannot be written: look at the folder and the disk's room");
    return size;
  }

  static std::string text_of(double value) { return nlohmann::json(value).dump(); }

  template <std::size_t kCount>
  static std::string joined(const std::array<double, kCount>& values) {
    std::string text;
    for (const double value : values) text += (text.empty() ? "" : ",") + text_of(value);
    return text;
  }

  struct Body {
    std::string bytes;
    std::string type;
  };
  static constexpr const char* kThinScan = "application/vnd.stillmap.scan";

  struct Request {
    std::string target;
    Body body;
    /// Null = whatever.
    const char* accept = nullptr;
    /// Whether it may be sent again after a lost connection.
    bool again = true;
    /// Instead of the client's.
    std::optional<int> retries{};
    std::optional<std::chrono::milliseconds> deadline{};
    /// Is sent, and becomes that of the answer.
    std::string* seal = nullptr;
    /// The map whose active version is asked; empty for others.
    std::string active_of{};
    /// Empty = not told.
    std::string region{};
  };
  static constexpr const char* kSeal = "Stillmap-Seal";
  static constexpr const char* kRevision = "Stillmap-Revision";

  static std::string place_of(const std::string& map, const std::string& version) {
    if (map.empty()) return "/v1";
    return "/v1/maps/" + map + (version.empty() ? "" : "/versions/" + version);
  }

  static nlohmann::json place_in(const std::optional<Prior>& prior,
                                 const std::optional<Gnss>& gnss) {
    nlohmann::json json = nlohmann::json::object();
    if (prior) json["prior"] = detail::to_json(*prior);
    if (gnss) json["gnss"] = detail::to_json(*gnss);
    return json;
  }

  /// What another program has answered, such as a proxy, is a Problem as well.
  template <typename Value, typename Read>
  static Value read(const httplib::Response& response, const Read& read_value) {
    const nlohmann::json json = nlohmann::json::parse(response.body, nullptr, false);
    if (json.is_discarded())
      throw Problem(response.status, "", found(response, "application/json"), std::nullopt);
    try {
      if constexpr (std::is_invocable_v<Read, const nlohmann::json&>) {
        return read_value(json);
      } else {
        return read_value(json, response);
      }
    } catch (const nlohmann::json::exception& error) {
      throw Problem(response.status, "",
                    std::string("found another answer than expected: ") + error.what(),
                    std::nullopt);
    }
  }

  static std::string with_vehicle(const std::string& path, const std::string& vehicle) {
    return vehicle.empty() ? path : httplib::append_query_params(path, {{"vehicle", vehicle}});
  }
  static std::string with_set(const std::string& path, const std::string& set) {
    return set.empty() ? path : httplib::append_query_params(path, {{"set", set}});
  }

  std::vector<BatchAnswer> send_batch(Request request, const std::vector<BatchItem>& items) {
    nlohmann::json wanted = {{"queries", nlohmann::json::array()}};
    std::vector<Body> scans;
    for (const BatchItem& item : items) {
      nlohmann::json query = detail::to_json(item.query);
      scans.push_back(body_of(item.points, is_to_thin(item.query)));
      if (!is_thin(scans.back())) query["layout"] = item.points.layout;
      wanted["queries"].push_back(std::move(query));
    }
    if (request.deadline) wanted["deadline_ms"] = request.deadline->count();
    request.body = multipart(wanted, scans, "scan-");
    const auto answers_of = [](const nlohmann::json& json) {
      std::vector<BatchAnswer> answers;
      for (const nlohmann::json& each : json.at("answers")) {
        BatchAnswer& answer = answers.emplace_back();
        if (each.at("status") == 200) {
          answer.answer = detail::answer_of(each.at("answer"));
        } else {
          answer.problem = Problem(each.at("status"), each.at("problem").at("code"),
                                   each.at("problem").at("detail"), std::nullopt);
        }
      }
      return answers;
    };
    return read<std::vector<BatchAnswer>>(post(request), answers_of);
  }

  static bool is_to_thin(const Query& query) {
    return query.movable.empty() && (query.method.empty() || query.method == "default");
  }
  static bool is_thin(const Body& scan) { return scan.type == kThinScan; }

  /// By a server that is configured for a vehicle of another size, or too old to know thin scans.
  static bool refuses_thin(const Problem& problem) {
    return problem.code == "InvalidScan" || problem.code == "UnsupportedMediaType";
  }

  /// What `send(true)` gives, for a thinned scan. If the server refuses that and takes the whole
  /// one, all later scans are sent whole, too.
  template <typename Send>
  httplib::Response thin_or_whole(bool may_thin, const Send& send) {
    if (!may_thin || !thin_profile_) return send(false);
    try {
      return send(true);
    } catch (const Problem& problem) {
      if (!refuses_thin(problem)) throw;
    }
    httplib::Response response = send(false);
    thin_profile_.reset();
    return response;
  }

  /// The server reads little-endian floats, as every machine that has a lidar writes them.
  /// @param may_thin  what the server does with it allows that.
  [[nodiscard]] Body body_of(const Points& points, bool may_thin) const {
    const std::size_t bytes = points.floats * sizeof(float);
    if (may_thin && thin_profile_) {
      localization::ScanView view;
      view.xyz = points.data;
      view.xyz_stride_bytes = points.layout.size() * sizeof(float);
      view.size = points.floats / points.layout.size();
      if (points.layout == "xyzit") {
        view.time_s = points.data + 4;
        view.time_stride_bytes = view.xyz_stride_bytes;
      }
      const std::vector<char> thin =
          localization::encode_thin_scan(view, *thin_profile_, own_vehicle_m_);
      if (thin.size() < bytes) return {{thin.begin(), thin.end()}, kThinScan};
    }
    return {{reinterpret_cast<const char*>(points.data), bytes}, "application/octet-stream"};
  }

  /// @param name  of the parts of the scans: `scan`, or `scan-` with their numbers behind it.
  static Body multipart(const nlohmann::json& request, const std::vector<Body>& scans,
                        const std::string& name) {
    // The server looks for it at the start of a line only, and floats are what they are.
    const std::string boundary = "stillmap-" + std::to_string(std::random_device{}()) + "-" +
                                 std::to_string(std::random_device{}());
    const auto head = [&](const std::string& part, const char* type) {
      return "--" + boundary + "\r\nContent-Disposition: form-data; name=\"" + part +
             "\"\r\nContent-Type: " + type + "\r\n\r\n";
    };
    Body body{head("request", "application/json") + request.dump() + "\r\n",
              "multipart/form-data; boundary=" + boundary};
    for (std::size_t i = 0; i < scans.size(); ++i) {
      const bool numbered = !name.empty() && name.back() == '-';
      body.bytes += head(numbered ? name + std::to_string(i) : name, scans[i].type.c_str());
      body.bytes += scans[i].bytes + "\r\n";
    }
    body.bytes += "--" + boundary + "--\r\n";
    return body;
  }

  /// Flat while it can be, since the server then knows all before the body.
  httplib::Response send_query(const std::string& map, const Points& points, const Query& query,
                               const char* accept) {
    const std::string path = with_set(place_of(map, query.version) + "/localize", query.set);
    return thin_or_whole(is_to_thin(query), [&](bool thin) {
      const Body scan = body_of(points, thin);
      Request request{path, {}, accept, true, {}, query.deadline};
      if (query.version.empty()) request.active_of = map;
      if (query.prior) request.region = region_of(query.prior->pose);
      if (query.T_base_lidar || !query.movable.empty() ||
          (query.prior && query.prior->covariance)) {
        nlohmann::json parameters = detail::to_json(query);
        if (query.deadline) parameters["deadline_ms"] = query.deadline->count();
        if (!is_thin(scan)) parameters["layout"] = points.layout;
        request.target = with_vehicle(path, query.vehicle);
        request.body = multipart(parameters, {scan}, "scan");
        return post(request);
      }
      httplib::Params flat = flat_of(query);
      if (!is_thin(scan)) flat.emplace("layout", points.layout);
      request.target = httplib::append_query_params(path, flat);
      request.body = scan;
      return post(request);
    });
  }

  static httplib::Params flat_of(const Query& query) {
    httplib::Params flat;
    if (query.prior) {
      flat.emplace("prior_t", joined(query.prior->pose.position));
      flat.emplace("prior_q", joined(query.prior->pose.quaternion));
      flat.emplace("prior_sigma",
                   joined(std::array<double, 2>{query.prior->sigma_m, query.prior->sigma_rad}));
    }
    if (const auto& gnss = query.gnss) {
      const std::string altitude = gnss->altitude_m ? text_of(*gnss->altitude_m) : std::string();
      flat.emplace("gnss", joined(std::array<double, 2>{gnss->latitude_deg, gnss->longitude_deg}) +
                               "," + altitude + "," + text_of(gnss->sigma_m));
    }
    if (query.stamp_ns) flat.emplace("stamp_ns", std::to_string(*query.stamp_ns));
    if (!query.method.empty()) flat.emplace("method", query.method);
    if (query.deadline) flat.emplace("deadline_ms", std::to_string(query.deadline->count()));
    if (!query.vehicle.empty()) flat.emplace("vehicle", query.vehicle);
    return flat;
  }

  httplib::Response send_scan(const std::string& session, const Points& points,
                              std::int64_t stamp_ns, const ScanOptions& options,
                              const char* accept) {
    const std::string path = "/v1/sessions/" + session + "/scans";
    return thin_or_whole(options.movable.empty(), [&](bool thin) {
      const Body scan = body_of(points, thin);
      if (options.odometry || options.T_base_lidar || !options.movable.empty()) {
        nlohmann::json request = detail::to_json(options, stamp_ns);
        if (!is_thin(scan)) request["layout"] = points.layout;
        return post({path, multipart(request, {scan}, "scan"), accept, false, options.retries,
                     options.deadline});
      }
      httplib::Params flat = {{"stamp_ns", std::to_string(stamp_ns)}};
      if (!is_thin(scan)) flat.emplace("layout", points.layout);
      if (options.deadline) flat.emplace("deadline_ms", std::to_string(options.deadline->count()));
      return post({httplib::append_query_params(path, flat), scan, accept, false, options.retries,
                   options.deadline});
    });
  }

  httplib::Response send_sealed(const std::string& map, std::string& seal, const Points& points,
                                std::int64_t stamp_ns, const ScanOptions& options,
                                const SessionOptions& start, const char* accept) {
    const std::string path = with_vehicle(
        with_set(place_of(map, start.version) + "/localize/next", start.set), start.label);
    nlohmann::json place = nlohmann::json::object();
    if (seal.empty()) place = place_in(start.prior, start.gnss);
    return thin_or_whole(options.movable.empty(), [&](bool thin) {
      const Body scan = body_of(points, thin);
      Request request{path, {}, accept, true, options.retries, options.deadline, &seal};
      if (start.version.empty()) request.active_of = map;
      request.region = options.region;
      if (seal.empty() && start.prior) request.region = region_of(start.prior->pose);
      if (options.odometry || options.T_base_lidar || !options.movable.empty() || !place.empty()) {
        nlohmann::json parameters = detail::to_json(options, stamp_ns);
        parameters.update(place);
        if (!is_thin(scan)) parameters["layout"] = points.layout;
        request.body = multipart(parameters, {scan}, "scan");
        return post(request);
      }
      httplib::Params flat = {{"stamp_ns", std::to_string(stamp_ns)}};
      if (!is_thin(scan)) flat.emplace("layout", points.layout);
      if (options.deadline) flat.emplace("deadline_ms", std::to_string(options.deadline->count()));
      request.target = httplib::append_query_params(path, flat);
      request.body = scan;
      return post(request);
    });
  }

  httplib::Response post(const Request& request) {
    httplib::Headers headers;
    if (request.seal != nullptr && !request.seal->empty()) headers.emplace(kSeal, *request.seal);
    if (request.accept != nullptr) headers.emplace("Accept", request.accept);
    if (!request.region.empty()) headers.emplace("Stillmap-Region", request.region);
    // So that no server that is behind another answers with an older version.
    if (const auto seen = revisions_->find(request.active_of); seen != revisions_->end())
      headers.emplace(kRevision, std::to_string(seen->second));
    be_patient(request.deadline.value_or(std::chrono::milliseconds(0)));
    const auto send = [&] {
      httplib::Result result =
          http_.Post(request.target, headers, request.body.bytes, request.body.type);
      if (request.seal != nullptr && result && result->has_header(kSeal))
        *request.seal = result->get_header_value(kSeal);
      if (!request.active_of.empty() && result && result->has_header(kRevision)) {
        std::int64_t& newest = (*revisions_)[request.active_of];
        newest = std::max<std::int64_t>(
            newest, std::strtoll(result->get_header_value(kRevision).c_str(), nullptr, 10));
      }
      return result;
    };
    return call(send, request.again, request.retries.value_or(retries_));
  }

  /// Bears the usual silence, and longer where the server may be silent on purpose.
  void be_patient(std::chrono::milliseconds silence) {
    constexpr std::chrono::seconds kMargin(5);
    http_.set_read_timeout(std::max<std::chrono::milliseconds>(
        timeout_, silence + std::chrono::milliseconds(kMargin)));
  }

  httplib::Response get(const std::string& target) {
    be_patient(std::chrono::milliseconds(0));
    return call([&] { return http_.Get(target); }, true, retries_);
  }

  /// Gives the body of a 2xx to `take` as it comes. @return the answer's head, the body of a
  /// refusal included; the status 0 when the connection was lost, or `take` said no more.
  httplib::Response stream(
      const std::string& target, const httplib::Headers& headers,
      const std::function<bool(const char*, std::size_t)>& take,
      const std::function<void(const httplib::Response&)>& begin = [](const auto&) {}) {
    httplib::Response head;
    const auto begun = [&](const httplib::Response& response) {
      head.status = response.status;
      head.headers = response.headers;
      if (response.status < 300) begin(response);
      return true;
    };
    const auto receive = [&](const char* data, std::size_t size) {
      if (head.status < 300) return take(data, size);
      constexpr std::size_t kMostProblemBytes = 1U << 16U;
      head.body.append(data, std::min(size, kMostProblemBytes - head.body.size()));
      return head.body.size() < kMostProblemBytes;
    };
    const httplib::Result result = http_.Get(target, headers, begun, receive);
    if (!result && head.status < 300) head.status = 0;
    return head;
  }

  /// @param again  whether it may be sent again after a lost connection.
  template <typename Send>
  httplib::Response call(const Send& send, bool again, int retries) {
    for (int tries = 1;; ++tries) {
      httplib::Result result = send();
      std::optional<Problem> problem;
      if (result) {
        // Redirections are not followed.
        if (result->status >= 200 && result->status < 300) return std::move(*result);
        problem = problem_of(*result);
        if (tries > retries || !is_passing(*problem)) throw *problem;
      } else if (tries > retries || !(again || result.error() == httplib::Error::Connection)) {
        throw ConnectionLost("no answer: " + httplib::to_string(result.error()));
      }
      std::this_thread::sleep_for(wait_time(tries, problem ? &*problem : nullptr));
    }
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
  std::optional<localization::ThinProfile> thin_profile_ = localization::ThinProfile::kExact;
  double own_vehicle_m_ = localization::kOwnVehicleM;
  std::chrono::milliseconds timeout_;
  int retries_;
  /// The newest of each map that was seen.
  std::shared_ptr<std::map<std::string, std::int64_t>> revisions_ =
      std::make_shared<std::map<std::string, std::int64_t>>();
};

/// Where a vehicle was in a set of maps when its session ended: the next one begins around there,
/// as far as the vehicle may have come since then. A large set needs a place to begin at.
class LastPlace {
 public:
  void note(const PoseAnswer& answer) {
    if (!answer.T_set_lidar || answer.status != "ok") return;
    pose_ = answer.T_set_lidar;
    at_ = std::chrono::steady_clock::now();
  }
  /// Nothing where nothing is known, as in one map: there it is searched for everywhere.
  [[nodiscard]] std::optional<Prior> prior() const {
    if (!pose_) return std::nullopt;
    const std::chrono::duration<double> age = std::chrono::steady_clock::now() - at_;
    const double way_m = 10.0 + kMostMS * age.count();
    Prior prior{*pose_};
    prior.covariance.emplace(Covariance{});
    const std::array<double, 6> deviations{way_m, way_m, 10.0, 0.2, 0.2, 2.0};
    for (std::size_t i = 0; i < 6; ++i) (*prior.covariance)[7 * i] = deviations[i] * deviations[i];
    return prior;
  }

 private:
  /// One standard deviation.
  static constexpr double kMostMS = 15.0;
  std::optional<Pose> pose_;
  std::chrono::steady_clock::time_point at_{};
};

/// One vehicle whose session travels with its scans: any server of a store goes on with it. A scan
/// whose answer was lost is sent again with the same seal, to the next server if there are several.
/// When the seal cannot be used any more (older than 60 s, its version removed) the scan is sent
/// again without it, and searched for everywhere; in a set of maps, around the last place.
class SealedSession {
 public:
  /// @param servers  of one store; one is enough behind a load balancer.
  /// @param start  how the first session begins; its retries are not looked at.
  /// @param seal  of a session to go on with; empty = one begins.
  SealedSession(std::vector<Client> servers, std::string map, SessionOptions start = {},
                std::string seal = {})
      : servers_(std::move(servers)),
        map_(std::move(map)),
        start_(std::move(start)),
        seal_(std::move(seal)) {
    if (servers_.empty()) throw std::invalid_argument("servers: found none, expected one or more");
    for (Client& server : servers_) server.revisions_ = servers_.front().revisions_;
  }

  /// The next scan, newer than the one before. @param options  its odometry is since the scan of
  /// the newest answer. @throws Problem (`ScanNotNewer`), ConnectionLost when no server answers.
  PoseAnswer track(const Points& points, std::int64_t stamp_ns, const ScanOptions& options = {}) {
    PoseAnswer answer = send(options, [&](Client& server, const ScanOptions& once) {
      return server.track_sealed(map_, seal_, points, stamp_ns, once, start_);
    });
    if (const auto& place = answer.T_set_lidar ? answer.T_set_lidar : answer.pose)
      region_ = region_of(*place);
    last_.note(answer);
    return answer;
  }
  /// The same as OGC GeoPose. @throws as `Client::localize_geopose`.
  GeoPose track_geopose(const Points& points, std::int64_t stamp_ns,
                        const ScanOptions& options = {}) {
    return send(options, [&](Client& server, const ScanOptions& once) {
      return server.track_sealed_geopose(map_, seal_, points, stamp_ns, once, start_);
    });
  }

  /// Forgets where the vehicle was: the next scan begins a session. Neither = it may be anywhere.
  void initialize(const std::optional<Prior>& prior = {}, const std::optional<Gnss>& gnss = {}) {
    seal_.clear();
    region_.clear();
    last_ = {};
    start_.prior = prior;
    start_.gnss = gnss;
  }

  /// The newest one; empty before the session begins.
  [[nodiscard]] const std::string& seal() const { return seal_; }
  /// How often a session began.
  [[nodiscard]] std::uint64_t begun() const { return begun_; }

 private:
  template <typename Ask>
  using Answer = std::invoke_result_t<const Ask&, Client&, const ScanOptions&>;

  template <typename Ask>
  Answer<Ask> send(const ScanOptions& options, const Ask& ask) {
    try {
      return ask_all(options, ask);
    } catch (const Problem& problem) {
      // Else no session would ever begin.
      if (problem.code == "InvalidPrior" || problem.code == "NoGeodeticOrigin") forget_place();
      if (!is_seal_spent(problem) || seal_.empty()) throw;
    }
    seal_.clear();
    start_.prior = last_.prior();
    return ask_all(options, ask);
  }

  /// The server that answered last; after a lost connection, or where it is busy, the next one.
  template <typename Ask>
  Answer<Ask> ask_all(const ScanOptions& options, const Ask& ask) {
    ScanOptions once = options;
    once.retries = 0;
    if (once.region.empty()) once.region = region_;
    const std::size_t most =
        servers_.size() + static_cast<std::size_t>(std::max(0, options.retries.value_or(kRetries)));
    for (std::size_t tries = 1;; ++tries) {
      const bool begins = seal_.empty();
      std::optional<Problem> busy;
      try {
        Answer<Ask> answer = ask(servers_[at_], once);
        note(begins);
        return answer;
      } catch (const Problem& problem) {
        note(begins);
        if (tries >= most || !is_passing(problem)) throw;
        busy = problem;
      } catch (const ConnectionLost&) {
        if (tries >= most) throw;
      }
      at_ = (at_ + 1) % servers_.size();
      if (tries % servers_.size() == 0)
        std::this_thread::sleep_for(
            wait_time(static_cast<int>(tries / servers_.size()), busy ? &*busy : nullptr));
    }
  }

  void note(bool begins) {
    if (!begins || seal_.empty()) return;
    ++begun_;
    forget_place();
  }
  /// Where it was at first says nothing of a later session.
  void forget_place() {
    start_.prior.reset();
    start_.gnss.reset();
  }

  static constexpr int kRetries = 4;
  std::vector<Client> servers_;
  std::size_t at_ = 0;
  std::string map_;
  SessionOptions start_;
  std::string seal_;
  std::string region_;
  LastPlace last_;
  std::uint64_t begun_ = 0;
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
    std::optional<Odometry> odometry{};
    std::vector<MovableBox> movable{};
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
  /// @param session  how the first one starts; later ones search everywhere.
  /// @param scans  of all scans: mount and deadline; its odometry and boxes are not looked at.
  SessionStream(Client client, std::string map, OnAnswer on_answer, OnError on_error,
                SessionOptions session = {}, ScanOptions scans = {})
      : client_(std::move(client)),
        map_(std::move(map)),
        on_answer_(std::move(on_answer)),
        on_error_(std::move(on_error)),
        opening_(std::move(session)),
        scans_(std::move(scans)),
        thread_([this] { work(); }) {}
  SessionStream(const SessionStream&) = delete;
  SessionStream& operator=(const SessionStream&) = delete;
  ~SessionStream() { stop(); }

  /// Drops what waits, waits for what is under way, ends the session. Later scans are not sent.
  void stop() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stopping_ = true;
    }
    changed_.notify_all();
    if (thread_.joinable()) thread_.join();
  }

  /// Takes the place of a scan that waits. @throws std::invalid_argument for what is no scan.
  void put(Scan scan) {
    static_cast<void>(Points(scan.points, scan.layout));
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      counts_.superseded += waiting_ ? 1 : 0;
      waiting_ = std::move(scan);
    }
    changed_.notify_all();
  }

  /// Says where the vehicle is: the session begins anew there, before the next scan is sent.
  void initialize(Prior prior) {
    const std::lock_guard<std::mutex> lock(mutex_);
    prior_ = std::move(prior);
  }

  /// Waits until nothing waits or is under way. @return whether that came in time.
  bool drain(std::chrono::milliseconds most) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, most, [this] { return !waiting_ && !busy_; });
  }

  [[nodiscard]] Counts counts() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return counts_;
  }

 private:
  void work() {
    int tries = 0;
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return waiting_.has_value() || stopping_; });
      if (stopping_) break;
      Scan scan = std::move(*waiting_);
      waiting_.reset();
      busy_ = true;
      lock.unlock();
      const auto pause = send(scan, tries);
      lock.lock();
      tries = pause ? tries + 1 : 0;
      if (pause) {
        changed_.wait_for(lock, *pause, [this] { return stopping_; });
        if (!waiting_) waiting_ = std::move(scan);
      }
      busy_ = false;
      changed_.notify_all();
    }
    lock.unlock();
    if (!session_.empty() && !opening_.sealed) client_.close_session(session_);
  }

  /// @return how long to wait before the newest scan is tried; nothing when this one is done with.
  std::optional<std::chrono::duration<double>> send(const Scan& scan, int tries) {
    PoseAnswer answer;
    try {
      if (const auto prior = take_prior()) begin_at(*prior);
      if (session_.empty() && !opening_.sealed) open();
      ScanOptions options = scans_;
      options.odometry = scan.odometry;
      options.movable = scan.movable;
      options.retries = 0;
      options.region = region_;
      const Points points(scan.points, scan.layout);
      answer = opening_.sealed ? track_sealed(points, scan.stamp_ns, options)
                               : client_.track(session_, points, scan.stamp_ns, options);
    } catch (const Problem& problem) {
      const bool gone = problem.code == "UnknownSession" || is_seal_spent(problem);
      if (gone) {
        session_.clear();
        opening_.prior = last_.prior();
      }
      failed(scan, problem);
      if (!gone && !is_passing(problem)) return std::nullopt;
      return wait_time(tries + 1, &problem);
    } catch (const Error& error) {
      failed(scan, error);
      return wait_time(tries + 1, nullptr);
    } catch (const std::exception& error) {
      // Whatever comes, the thread must be there for the next scan.
      failed(scan, Error(error.what()));
      return std::nullopt;
    }
    count(&Counts::answered);
    last_.note(answer);
    on_answer_(scan.stamp_ns, answer);
    return std::nullopt;
  }

  std::optional<Prior> take_prior() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return std::exchange(prior_, std::nullopt);
  }

  /// After a refusal that may pass, the next scan tries again.
  void begin_at(const Prior& prior) {
    if (opening_.sealed) session_.clear();
    if (session_.empty()) {
      opening_.prior = prior;
      opening_.gnss.reset();
      return;
    }
    const auto keep = [&] {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!prior_) prior_ = prior;
    };
    try {
      client_.initialize(session_, prior, {}, 0);
    } catch (const Problem& problem) {
      if (is_passing(problem) || problem.code == "UnknownSession") keep();
      throw;
    } catch (const ConnectionLost&) {
      keep();
      throw;
    }
  }

  PoseAnswer track_sealed(const Points& points, std::int64_t stamp_ns, const ScanOptions& options) {
    const bool begins = session_.empty();
    try {
      PoseAnswer answer = client_.track_sealed(map_, session_, points, stamp_ns, options, opening_);
      if (const auto& place = answer.T_set_lidar ? answer.T_set_lidar : answer.pose)
        region_ = region_of(*place);
      if (begins) begun();
      return answer;
    } catch (const Problem& problem) {
      forget_unusable_place(problem);
      throw;
    }
  }

  void open() {
    // Not tried again here: meanwhile a newer scan may have come, and the stream may have ended.
    opening_.retries = 0;
    try {
      session_ = client_.open_session(map_, opening_);
    } catch (const Problem& problem) {
      forget_unusable_place(problem);
      throw;
    }
    begun();
  }
  /// Else no scan would ever be sent.
  void forget_unusable_place(const Problem& problem) {
    constexpr int kUnprocessable = 422;
    if (problem.status == kUnprocessable) opening_.prior.reset();
  }
  void begun() {
    // Where it was at first says nothing of a later session.
    opening_.prior.reset();
    opening_.gnss.reset();
    count(&Counts::sessions);
  }
  void failed(const Scan& scan, const Error& error) {
    count(&Counts::failed);
    on_error_(scan.stamp_ns, error);
  }
  void count(std::uint64_t Counts::*which) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++(counts_.*which);
  }

  Client client_;
  std::string map_;
  OnAnswer on_answer_;
  OnError on_error_;
  SessionOptions opening_;
  ScanOptions scans_;
  std::string session_;  // of the sending thread; a seal where sessions are sealed
  /// Where the vehicle was last; of a sealed session.
  std::string region_;
  LastPlace last_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Scan> waiting_;
  std::optional<Prior> prior_;
  bool busy_ = false;
  bool stopping_ = false;
  Counts counts_;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace stillmap::client
