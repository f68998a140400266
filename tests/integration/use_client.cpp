// Calls all that the C++ client offers, once with everything that a call takes, against a server
// that answers by the document; prints what the client's types hold of the answers as JSON, in the
// document's names. `client_coverage_test.py` holds both against server/openapi.json.
//
//   use_client URL FOLDER
//
// Or follows a drive with a sealed session over real servers, for `sealed_sessions_test.py`:
//
//   use_client follow URL,URL... SCAN...

#include "stillmap_client.hpp"

#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <sstream>

namespace {

namespace client = stillmap::client;
using nlohmann::json;

template <typename Value>
json json_of(const std::optional<Value>& value) {
  return value ? json(*value) : json();
}

json json_of(const std::optional<client::Pose>& pose) {
  return pose ? json{{"position", pose->position}, {"quaternion", pose->quaternion}} : json();
}

json json_of_stamp(const std::optional<std::int64_t>& stamp_ns) {
  return stamp_ns ? json(std::to_string(*stamp_ns)) : json();
}

json json_of(const client::MapReference& map) {
  return {{"name", map.name}, {"version", map.version}, {"digest", map.digest}};
}

json json_of(const client::PoseAnswer& answer) {
  json warnings = json::array();
  for (const auto& each : answer.warnings)
    warnings.push_back({{"code", each.code},
                        {"ahead_s", each.ahead_s},
                        {"version", each.version},
                        {"from_map", each.from_map}});
  const auto& [longitudinal, lateral, vertical, yaw] = answer.protection;
  return {{"status", answer.status},
          {"reasons", answer.reasons},
          {"pose", json_of(answer.pose)},
          {"set", answer.set},
          {"T_set_lidar", json_of(answer.T_set_lidar)},
          {"T_map_base", json_of(answer.T_map_base)},
          {"covariance", json_of(answer.covariance)},
          {"covariance_order", answer.covariance_order},
          {"protection",
           {{"longitudinal_m", json_of(longitudinal)},
            {"lateral_m", json_of(lateral)},
            {"vertical_m", json_of(vertical)},
            {"yaw_rad", json_of(yaw)}}},
          {"inlier_ratio", answer.inlier_ratio},
          {"rmse_m", answer.rmse_m},
          {"movable_points", answer.movable_points},
          {"no_returns", answer.no_returns},
          {"degenerate_directions", answer.degenerate_directions},
          {"prior_to_pose", {{"m", answer.prior_to_pose->m}, {"rad", answer.prior_to_pose->rad}}},
          {"iterations", answer.iterations},
          {"map", json_of(answer.map)},
          {"stamp_ns", json_of_stamp(answer.stamp_ns)},
          {"timing_ms",
           {{"wait", answer.timing.wait_ms},
            {"decode", answer.timing.decode_ms},
            {"align", answer.timing.align_ms},
            {"total", answer.timing.total_ms}}},
          {"warnings", warnings},
          {"request_id", answer.request_id},
          {"session", answer.session},
          {"searched_from", answer.searched_from}};
}

json json_of(const client::SessionInfo& info) {
  return {{"id", info.id},
          {"label", info.label},
          {"map", json_of(info.map)},
          {"active_version", info.active_version},
          {"scans", info.scans},
          {"status", info.status},
          {"reasons", info.reasons},
          {"stamp_ns", json_of_stamp(info.stamp_ns)},
          {"pose", json_of(info.pose)},
          {"pose_stamp_ns", json_of_stamp(info.pose_stamp_ns)},
          {"covariance", json_of(info.covariance)},
          {"covariance_order", info.covariance_order},
          {"inlier_ratio", json_of(info.inlier_ratio)},
          {"idle_s", info.idle_s},
          {"idle_limit_s", info.idle_limit_s},
          {"key_id", info.key_id},
          {"key_name", info.key_name},
          {"set", info.set}};
}

json json_of(const client::GeoPose& pose) {
  return {{"status", pose.status},
          {"reasons", pose.reasons},
          {"place", {pose.longitude_deg, pose.latitude_deg, pose.height_m}},
          {"quaternion", pose.quaternion},
          {"valid_time_ms", json_of(pose.valid_time_ms)}};
}

json use(const std::string& url, const std::string& folder) {
  client::Client server(url, "", std::chrono::seconds(5), 1);
  const std::vector<float> xyzi(4 * 60, 1.0F);
  const client::Pose pose{{1.0, 2.0, 3.0}, {0.0, 0.0, 0.6, 0.8}};
  const client::Prior prior{pose, 0.5, 0.1, {}};
  const client::Gnss gnss{49.0, 8.4, 2.0, 110.0};
  const std::chrono::milliseconds deadline(900);
  client::Covariance covariance{};
  for (std::size_t i = 0; i < 6; ++i) covariance[7 * i] = 0.01;
  const client::Prior full{pose, 0.0, 0.0, covariance};
  const std::vector<client::MovableBox> boxes = {{{1.0, 2.0, 3.0}, {4.0, 2.0, 1.5}, 0.3}};
  const client::Query flat{prior, {}, {}, {}, 7, "default", deadline, {}};
  const client::Query fix{{}, gnss, {}, {}, {}, {}, {}, {}};
  const client::Query all{full, gnss, pose, boxes, 7, "icp", deadline, "v1", "truck 7"};

  json found;
  for (client::Query query : {flat, fix, all}) {
    query.version = "v1";
    found["localizeInVersion"] = json_of(server.localize("town", xyzi, query));
    query.version.clear();
    found["localize"] = json_of(server.localize("town", xyzi, query));
  }
  for (client::Query query : {flat, fix, all}) {
    query.version.clear();
    query.set = "city";
    found["localizeInSet"] = json_of(server.localize("", xyzi, query));
  }
  found["geopose localizeInSet"] = json_of(server.localize_geopose("", xyzi, flat));
  found["geopose localize"] = json_of(server.localize_geopose("town", xyzi, flat));
  server.localize_geopose("town", xyzi, all);
  const std::vector<client::Client::BatchItem> items = {{xyzi, all}};
  found["localizeBatch"] =
      json_of(*server.localize_batch("town", items, "", deadline, "truck 7").at(0).answer);
  found["localizeBatchInVersion"] =
      json_of(*server.localize_batch("town", items, "v1", deadline, "truck 7").at(0).answer);
  const std::string session = server.open_session("town", {full, gnss, "v1", "truck 7", 0});
  server.open_session("town");
  client::SessionOptions in_set{full, gnss, "", "truck 7", 0};
  in_set.set = "city";
  server.open_session("", in_set);
  client::ScanOptions scan{client::Odometry{5, pose, 0.1, 0.01, {}}, pose, boxes, deadline, 0};
  server.track(session, xyzi, 7, scan);
  found["geopose trackScan"] = json_of(server.track_geopose(session, xyzi, 7));
  scan = {};
  scan.deadline = deadline;
  found["trackScan"] = json_of(server.track(session, xyzi, 7, scan));
  std::vector<client::Client> servers;
  servers.emplace_back(url);
  client::SealedSession sealed(std::move(servers), "town");
  sealed.track_geopose(xyzi, 7);
  sealed.track(xyzi, 8);
  sealed.track(xyzi, 9);
  std::string seal;
  client::ScanOptions all_of_scan{client::Odometry{5, pose, 0.1, 0.01, {}}, pose, boxes, deadline,
                                  0};
  for (const std::string version : {"", "v1"}) {
    const std::string name = version.empty() ? "trackSealed" : "trackSealedInVersion";
    const client::SessionOptions start{full, gnss, version, "truck 7", 0};
    seal.clear();
    server.track_sealed("town", seal, xyzi, 7, all_of_scan, start);
    found["geopose " + name] =
        json_of(server.track_sealed_geopose("town", seal, xyzi, 7, scan, start));
    found[name] = json_of(server.track_sealed("town", seal, xyzi, 7, scan, start));
  }
  seal.clear();
  server.track_sealed("", seal, xyzi, 7, all_of_scan, in_set);
  found["geopose trackSealedInSet"] =
      json_of(server.track_sealed_geopose("", seal, xyzi, 7, scan, in_set));
  found["trackSealedInSet"] = json_of(server.track_sealed("", seal, xyzi, 7, scan, in_set));
  server.initialize(session);
  found["initializeSession"] = json_of(server.initialize(session, full, gnss));
  found["getSession"] = json_of(server.session(session));
  server.sessions();
  found["listSessions"] = json_of(server.sessions("town").at(0));
  found["events"] = json::array();
  server.events(
      session,
      [&](const client::Event& event) {
        found["events"].push_back({json_of(event.id), event.type, event.data});
        return true;
      },
      3);
  server.close_session(session);
  found["bytes"] = server.download_version("town", "v1", folder + "/v1.tar");
  server.download_version("town", "v2", folder + "/v2.tar", std::string(64, '0'));
  return found;
}

std::vector<float> scan_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  std::vector<float> floats(bytes.size() / sizeof(float));
  std::memcpy(floats.data(), bytes.data(), floats.size() * sizeof(float));
  return floats;
}

/// Follows scans with a sealed session, 0.1 s apart. @return answers, and how often it began.
json follow(const std::vector<std::string>& urls, const std::vector<std::string>& scans) {
  std::vector<client::Client> servers;
  for (const std::string& url : urls) servers.emplace_back(url, "", std::chrono::seconds(5), 0);
  client::SessionOptions start;
  start.prior = client::Prior{{}, 0.5, 0.05, {}};
  client::SealedSession session(std::move(servers), "town", start);
  json answers = json::array();
  std::int64_t stamp_ns = 0;
  for (const std::string& scan : scans)
    answers.push_back(session.track(scan_of(scan), stamp_ns += 100'000'000).json);
  return {{"answers", answers}, {"begun", session.begun()}};
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 3) return 2;
  try {
    if (std::string(arguments[1]) == "follow") {
      std::vector<std::string> urls;
      std::istringstream text(arguments[2]);
      for (std::string url; std::getline(text, url, ',');) urls.push_back(url);
      std::cout << follow(urls, {arguments + 3, arguments + count}) << '\n';
      return 0;
    }
    std::cout << use(arguments[1], arguments[2]) << '\n';
    return 0;
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
}
